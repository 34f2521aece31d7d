"""A link that turns out worse than declared, on a shaped network of two namespaces. Needs root, ip and tc.

python -m tests.benchmarks.bench_link_radio [--real-mbps 3 1 0.5] [--adapt]

Declared 6 Mbps, 4 offered in ten frames a second, every twentieth five times as large, a key frame. Three seconds on
a link of 8 Mbps, then eight on the real one
(``tc tbf``, which queues 100 ms), then five on the first again. Prints what is known 2 s after each change, how long
the estimate takes to be within 10 % of what ``tc`` lets through, and how old the frames are when they are read.
With --adapt the frames are made to fit 85 % of the estimate, anew every second, as a plan that is made again would.
"""

from __future__ import annotations

import argparse
import json
import os
import queue
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.receiver import Receiver
from pipeline.link.sender import LinkSender
from pipeline.link.token_bucket import TokenBucket
from pipeline.messages import CameraPose, EndOfStream, Message, Packet
from pipeline.mission.stages.virtual_link import burst_bytes

ROOT = Path(__file__).resolve().parents[2]
DECLARED_BPS, OFFERED_BPS, FRAME_HZ = 6e6, 4e6, 10.0
GOOD_MBPS, BEFORE_S, WORSE_S, AFTER_S = 8.0, 3.0, 8.0, 5.0
#: of an Ethernet frame of 1514 bytes, what TCP with time stamps carries; tc counts the whole
PAYLOAD = 1448 / 1514
_POSE = CameraPose(np.zeros(3), np.eye(3))


@dataclass(frozen=True)
class Network:
    """Names of two namespaces, joined by a cable; the first end of it is shaped."""

    near: str
    far: str

    def shape(self, mbps: float, verb: str = "change") -> None:
        shaper = f"tbf rate {round(mbps * 1000)}kbit burst 3kb latency 100ms"
        _run(f"ip netns exec {self.near} tc qdisc {verb} dev {self.near} root {shaper}")

    def python(self, where: str, *arguments: object) -> subprocess.Popen[str]:
        words = ["ip", "netns", "exec", where, sys.executable, "-m", "tests.benchmarks.bench_link_radio"]
        return subprocess.Popen(
            [*words, *map(str, arguments)], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )


@contextmanager
def network() -> Iterator[Network]:
    """Two namespaces, gone afterwards."""
    net = Network(f"sl{os.getpid()}a", f"sl{os.getpid()}b")
    try:
        for name in (net.near, net.far):
            _run(f"ip netns add {name}")
        _run(f"ip link add {net.near} netns {net.near} type veth peer name {net.far} netns {net.far}")
        for name, address in ((net.near, "10.9.9.1/24"), (net.far, "10.9.9.2/24")):
            _run(f"ip netns exec {name} ip address add {address} dev {name}")
            _run(f"ip netns exec {name} ip link set {name} up")
            # else one "packet" of 64 KB is larger than what the shaper lets through at once
            _run(f"ip netns exec {name} ip link set {name} gso_max_size 1500 gso_max_segs 1")
        net.shape(GOOD_MBPS, "add")
        yield net
    finally:
        for name in (net.near, net.far):
            subprocess.run(["ip", "netns", "delete", name], check=False)


def receive() -> None:
    """The far end: (index, age, monotonic time, bytes) of each frame as one line of JSON."""
    inbox: queue.Queue[tuple[float, Message]] = queue.Queue()
    keys = KeyPair()
    receiver = Receiver("10.9.9.2", lambda m: inbox.put((time.monotonic(), m)), keys=keys, port=9999)
    print(keys.public.hex(), flush=True)
    receiver.accept_only({bytes.fromhex(input()): "near"})
    frames = []
    while isinstance((item := inbox.get())[1], Packet):
        frames.append((item[1].index, item[0] - item[1].encode_s, item[0], len(item[1].data)))
    print(json.dumps(frames), flush=True)
    receiver.close()


def send(adapt: bool, far: str) -> None:
    """The near end: (monotonic time, estimate, backlog, full) every 50 ms as one line of JSON. far: its public key."""
    keys = KeyPair()
    print(keys.public.hex(), flush=True)
    sender = LinkSender(
        TokenBucket(DECLARED_BPS, burst_bytes(DECLARED_BPS)), keys=keys, capacity_bytes=4_000_000
    )
    sender.connect("far", Endpoint("10.9.9.2", 9999, bytes.fromhex(far)))
    states, skipped, offered_bps = [], [], OFFERED_BPS
    begin_s = time.monotonic()
    print(begin_s, flush=True)
    for step in range(round((BEFORE_S + WORSE_S + AFTER_S) * 20)):
        time.sleep(max(0.0, begin_s + step / 20 - time.monotonic()))
        state, now_s = sender.state(), time.monotonic()
        states.append((now_s, state.rate_bps, min(state.backlog_s, 1e6), state.full))
        if step % 20 == 0 and adapt:
            offered_bps = min(OFFERED_BPS, 0.85 * state.rate_bps)
        if step % 2 == 0 and state.backlog_s <= 1.0:
            # a key frame every two seconds, five times as large as the others
            nbytes = max(300, round(offered_bps / FRAME_HZ / 8 / 1.2 * (1 if step % 40 else 5) - 230))
            packet = Packet("a", "d", step // 2, 0, 0, 1, 10, False, _POSE, bytes(nbytes), encode_s=now_s)
            sender.send("far", packet, timeout_s=0)
        elif step % 2 == 0:
            skipped.append(now_s)
    sender.send("far", EndOfStream("a", "d"))
    sender.flush(30.0)
    sender.close()
    print(json.dumps([states, skipped]), flush=True)


def measure(net: Network, real_mbps: float, adapt: bool) -> str:
    """One line of the table."""
    net.shape(GOOD_MBPS)
    far = net.python(net.far, "--role", "receive")
    assert far.stdout is not None
    assert far.stdin is not None
    key = far.stdout.readline().strip()
    near = net.python(net.near, "--role", "send", "--far", key, *(["--adapt"] if adapt else []))
    assert near.stdout is not None
    print(near.stdout.readline().strip(), file=far.stdin, flush=True)
    begin_s = float(near.stdout.readline())
    time.sleep(max(0.0, begin_s + BEFORE_S - time.monotonic()))
    net.shape(real_mbps)
    worse_s = time.monotonic()
    time.sleep(max(0.0, begin_s + BEFORE_S + WORSE_S - time.monotonic()))
    net.shape(GOOD_MBPS)
    good_s = time.monotonic()
    states, skipped = json.loads(near.stdout.readline())
    frames = json.loads(far.stdout.readline())
    near.wait(10)
    far.wait(10)
    real_bps = real_mbps * 1e6 * PAYLOAD
    within = [abs(rate / real_bps - 1.0) <= 0.1 for at_s, rate, *_ in states if worse_s < at_s < good_s]
    first = next((k for k in range(len(within)) if all(within[k : k + 10])), None)
    later = sum(within[40:]) / len(within[40:])
    ages_s = [age_s for _, age_s, at_s, _ in frames if worse_s + 3.0 <= at_s < good_s]
    late = np.percentile(ages_s, [50, 95, 100]) if ages_s else [float("nan")] * 3
    looks = sum(n for *_, at_s, n in frames if worse_s + 3.0 <= at_s < good_s) * 8 / (good_s - worse_s - 3.0)
    return (
        f"| {real_mbps:g} | {'yes' if adapt else 'no'} | {_at(states, worse_s + 2.0) / 1e6:.2f} "
        f"| {'never' if first is None else f'{first * 0.05:.2f} s'} | {later:.0%} | {looks / real_bps:.0%} "
        f"| {late[0]:.2f}, {late[1]:.2f}, {late[2]:.2f} s | {sum(s < good_s for s in skipped)} "
        f"| {_at(states, good_s + 2.0) / 1e6:.2f}, {states[-1][1] / 1e6:.2f} |"
    )


def _at(states: list[tuple[float, float, float, bool]], at_s: float) -> float:
    """The estimate at a moment, bit/s."""
    return next(rate for when_s, rate, *_ in states if when_s >= at_s)


def _run(command: str) -> None:
    subprocess.run(command.split(), check=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--real-mbps", type=float, nargs="+", default=[3.0, 1.0, 0.5])
    parser.add_argument("--adapt", action="store_true")
    parser.add_argument("--far", default="", help=argparse.SUPPRESS)
    parser.add_argument("--role", choices=["send", "receive"], help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.role == "receive":
        receive()
    elif arguments.role == "send":
        send(arguments.adapt, arguments.far)
    else:
        print(
            "| Mbps of tc | adapted | known after 2 s | within 10 % after | then within 10 % | link used "
            "| age p50, p95, most, from 3 s on | frames dropped | 2 s, 5 s after it is good again |"
        )
        with network() as net:
            for real_mbps in arguments.real_mbps:
                print(measure(net, real_mbps, arguments.adapt), flush=True)


if __name__ == "__main__":
    main()

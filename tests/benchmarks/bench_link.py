"""How well a throttled link keeps its bandwidth, and how long messages take.

python tests/benchmarks/bench_link.py [--seconds 60] [--mbps 5]

The first part floods the link with packets of mixed sizes and compares what went through with what is
set; the second sends single packets over an idle link of infinite rate.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import queue
import random
import time
from multiprocessing.connection import Connection

import numpy as np

from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.receiver import Receiver
from pipeline.link.records import record_bytes
from pipeline.link.sender import LinkSender
from pipeline.link.token_bucket import TokenBucket
from pipeline.messages import CameraPose, EndOfStream, Message, Packet, pack

TOLERANCE = 0.03
KEYS = KeyPair()
BURST_S = 0.05
SIZES_BYTES = (1_000, 20_000, 200_000, 1_700_000)
_POSE = CameraPose(np.zeros(3), np.eye(3))


def packet(nbytes: int, index: int = 0) -> Packet:
    now_ns = time.monotonic_ns()
    return Packet("drone", "detector", index, 0, 0, 1, 30, False, _POSE, bytes(nbytes), sent_ns=now_ns)


def receive(pipe: Connection, sender: bytes) -> None:
    """The other process: tells (arrival ns, sent ns, wire bytes) of each packet when the stream ends."""
    inbox: queue.Queue[tuple[int, Message]] = queue.Queue()
    receiver = Receiver(
        "127.0.0.1", lambda m: inbox.put((time.monotonic_ns(), m)), keys=KeyPair(), peers={sender: "sender"}
    )
    pipe.send(receiver.endpoint)
    arrivals = []
    while not isinstance((item := inbox.get())[1], EndOfStream):
        arrivals.append((item[0], item[1].sent_ns, record_bytes(pack(item[1]))))
    pipe.send(arrivals)
    receiver.close()


class Peer:
    """A receiver in another process."""

    def __enter__(self) -> Peer:
        self.pipe, theirs = multiprocessing.Pipe()
        self.process = multiprocessing.get_context("spawn").Process(
            target=receive, args=(theirs, KEYS.public), daemon=True
        )
        self.process.start()
        self.endpoint: Endpoint = self.pipe.recv()
        return self

    def finish(self, sender: LinkSender) -> list[tuple[int, int, int]]:
        sender.send("peer", EndOfStream("drone", "detector"))
        return self.pipe.recv()

    def __exit__(self, *_: object) -> None:
        self.process.join(timeout=5.0)


def bandwidth(seconds: float, rate_bps: float) -> float:
    """Bits per second that arrived, the first message excluded: it opens the window."""
    sizes = random.Random(1)
    sender = LinkSender(
        TokenBucket(rate_bps, max(2000.0, rate_bps / 8 * BURST_S)), keys=KEYS, capacity_bytes=200_000
    )
    with Peer() as peer:
        sender.connect("peer", peer.endpoint)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            sender.send("peer", packet(sizes.choice((200, 2_000, 8_000, 20_000, 60_000))))
        arrivals = peer.finish(sender)
    sender.close()
    span_s = (arrivals[-1][0] - arrivals[0][0]) / 1e9
    return sum(nbytes for _, _, nbytes in arrivals[1:]) * 8 / span_s


def latencies_us(nbytes: int, count: int) -> np.ndarray:
    """Microseconds from making a packet to its arrival in the other process, one at a time."""
    sender = LinkSender(TokenBucket(math.inf, 1), keys=KEYS, capacity_bytes=10**8)
    with Peer() as peer:
        sender.connect("peer", peer.endpoint)
        for index in range(count):
            sender.send("peer", packet(nbytes, index))
            sender.flush(10.0)
            time.sleep(0.005)
        arrivals = peer.finish(sender)
    sender.close()
    return np.array([(arrived - sent) / 1e3 for arrived, sent, _ in arrivals])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--mbps", type=float, default=5.0)
    arguments = parser.parse_args()
    obtained = bandwidth(arguments.seconds, arguments.mbps * 1e6) / 1e6
    error = obtained / arguments.mbps - 1.0
    print(
        f"set {arguments.mbps:g} Mbps, obtained {obtained:.4f} Mbps: {error:+.2%} ({arguments.seconds:g} s)"
    )
    for nbytes in SIZES_BYTES:
        times = latencies_us(nbytes, 300)
        p50, p99 = np.percentile(times, [50, 99])
        print(f"{nbytes:>9} bytes: latency p50 {p50:.0f} us, p99 {p99:.0f} us")
    if abs(error) > TOLERANCE:
        raise SystemExit(f"not within {TOLERANCE:.0%}")


if __name__ == "__main__":
    main()

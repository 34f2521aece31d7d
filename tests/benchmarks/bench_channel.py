"""The channel (authenticated, encrypted, acknowledged, replay-safe) beside plain TCP with msgpack, in one run.

python -m tests.benchmarks.bench_channel [--rounds 5] [--messages 20000] [--goodput]

Both carry the same packets of 20 KB, pose and all, from one process to another on loopback, as fast as they are taken,
and then one by one. Plain TCP packs the same values with msgpack, a length before them, and believes what it reads. The
rounds alternate; the figure is the median of the rounds' ratios. --goodput: what passes a link of a stated rate
instead, in bytes of records, over 20 s each.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import socket
import struct
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection

import msgpack
import numpy as np

from pipeline.link.keys import KeyPair
from pipeline.link.receiver import Receiver
from pipeline.link.records import record_bytes
from pipeline.link.sender import LinkSender
from pipeline.link.token_bucket import TokenBucket
from pipeline.messages import CameraPose, EndOfStream, Message, Packet, pack
from pipeline.mission.stages.virtual_link import burst_bytes

_POSE = CameraPose(np.zeros(3), np.eye(3))
_LENGTH = struct.Struct(">I")
DATA = bytes(20_000)
GOODPUT_MBPS = (0.25, 1.0, 5.0, 20.0)


def packet(index: int, data: bytes = DATA) -> Packet:
    """Stamped with the time of its making, which both processes share."""
    return Packet("drone-1", "d", index, index, 0, 1, 30, False, _POSE, data, sent_ns=time.monotonic_ns())


def plain_receiver(pipe: Connection) -> None:
    """Tells (arrival, age) in ns of each packet."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        pipe.send(server.getsockname())
        connection, _ = server.accept()
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    got = []
    with connection, connection.makefile("rb", buffering=256 * 1024) as stream:
        while len(head := stream.read(4)) == 4:
            values = msgpack.unpackb(stream.read(_LENGTH.unpack(head)[0]))
            now_ns = time.monotonic_ns()
            got.append((now_ns, now_ns - values[11]))
    pipe.send(got)


def channel_receiver(pipe: Connection, sender: bytes) -> None:
    """The same of the channel; the size of the record beside it."""
    got: list[tuple[int, int, int]] = []
    ended = threading.Event()

    def take(message: Message) -> None:
        if isinstance(message, Packet):
            now_ns = time.monotonic_ns()
            got.append((now_ns, now_ns - message.sent_ns, len(message.data)))
        else:
            ended.set()

    receiver = Receiver("127.0.0.1", take, keys=KeyPair(), peers={sender: "sender"})
    pipe.send(receiver.endpoint)
    ended.wait()
    pipe.send(got)
    receiver.close()


def _spawn(target: Callable[..., None], *arguments: object) -> tuple[Connection, multiprocessing.Process]:
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(
        target=target, args=(theirs, *arguments), daemon=True
    )
    process.start()
    return ours, process  # type: ignore[return-value]


def plain(count: int, gap_s: float) -> tuple[float, float]:
    """Messages a second, and the median age in microseconds."""
    pipe, process = _spawn(plain_receiver)
    with socket.create_connection(pipe.recv()) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        begin_ns = time.monotonic_ns()
        for index in range(count):
            p = packet(index)
            pose = [_POSE.position_enu.tobytes(), _POSE.enu_from_camera.tobytes(), 0.0, 0.0, 0.0, 1.0]
            values = [
                p.stream,
                p.detector,
                p.index,
                p.time_ns,
                p.pts,
                1,
                30,
                False,
                pose,
                p.data,
                0.0,
                p.sent_ns,
            ]
            data = msgpack.packb(values)
            connection.sendall(_LENGTH.pack(len(data)) + data)
            if gap_s:
                time.sleep(gap_s)
    got = pipe.recv()
    process.join()
    return count / (got[-1][0] - begin_ns) * 1e9, float(np.median([age for _, age in got])) / 1e3


def channel(count: int, gap_s: float) -> tuple[float, float]:
    """The same."""
    keys = KeyPair()
    pipe, process = _spawn(channel_receiver, keys.public)
    sender = LinkSender(TokenBucket(math.inf, 1e6), keys=keys, capacity_bytes=4_000_000)
    sender.connect("peer", pipe.recv())
    begin_ns = time.monotonic_ns()
    for index in range(count):
        sender.send("peer", packet(index))
        if gap_s:
            time.sleep(gap_s)
    sender.send("peer", EndOfStream("drone-1", "d"))
    assert sender.flush(30.0), "all was acknowledged"
    got = pipe.recv()
    sender.close()
    process.join()
    assert len(got) == count
    return count / (got[-1][0] - begin_ns) * 1e9, float(np.median([age for _, age, _ in got])) / 1e3


def goodput(mbps: float, seconds: float) -> float:
    """Rate of records over the rate that is set, in the middle of a flood; the first second fills the window."""
    keys, rate_bps = KeyPair(), mbps * 1e6
    pipe, process = _spawn(channel_receiver, keys.public)
    sender = LinkSender(TokenBucket(rate_bps, burst_bytes(rate_bps)), keys=keys, capacity_bytes=200_000)
    sender.connect("peer", pipe.recv())
    nbytes = int(min(20_000, rate_bps / 8 / 20))
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        sender.send("peer", packet(0, bytes(nbytes)))
    sender.send("peer", EndOfStream("drone-1", "d"))
    assert sender.flush(60.0)
    got = pipe.recv()
    sender.close()
    process.join()
    record = record_bytes(pack(packet(0, bytes(nbytes))))
    later = [at_ns for at_ns, _, _ in got if at_ns > got[0][0] + 1e9]
    return (len(later) - 1) * record * 8e9 / (later[-1] - later[0]) / rate_bps


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--messages", type=int, default=20_000)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--goodput", action="store_true")
    arguments = parser.parse_args()
    if arguments.goodput:
        for mbps in GOODPUT_MBPS:
            print(f"{mbps:g} Mbps set: {goodput(mbps, arguments.seconds) - 1.0:+.3%}", flush=True)
        return
    rates, ages = [], []
    for _ in range(arguments.rounds):
        (plain_rate, _), (rate, _) = plain(arguments.messages, 0.0), channel(arguments.messages, 0.0)
        (_, plain_us), (_, us) = plain(300, 0.005), channel(300, 0.005)
        rates.append(rate / plain_rate)
        ages.append(us / plain_us)
        print(
            f"plain TCP {plain_rate:,.0f}/s, {plain_us:.0f} us; channel {rate:,.0f}/s, {us:.0f} us: "
            f"{rates[-1]:.0%} of its rate, {ages[-1]:.2f} times its latency",
            flush=True,
        )
    print(f"median: {np.median(rates):.0%} of its rate, {np.median(ages):.2f} times its latency")


if __name__ == "__main__":
    main()

"""Who says nothing, or too little, or whom nobody knows, holds up nobody else and costs little."""

from __future__ import annotations

import os
import queue
import resource
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress

import pytest

from pipeline.link.handshake import HELLO
from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.params import LinkParams
from pipeline.link.receiver import Receiver
from pipeline.link.sender import LinkSender
from pipeline.link.token_bucket import TokenBucket
from pipeline.messages import EndOfStream, Message

KEYS = KeyPair()
PEERS = {KEYS.public: "a peer"}
WAIT_S = 20.0
END = EndOfStream("v", "d")


@pytest.fixture
def inbox() -> Iterator[tuple[Receiver, queue.Queue[Message]]]:
    messages: queue.Queue[Message] = queue.Queue()
    receiver = Receiver("127.0.0.1", messages.put, keys=KEYS, peers=PEERS)
    yield receiver, messages
    receiver.close()


def served_after_s(endpoint: Endpoint, messages: queue.Queue[Message]) -> float:
    """How long a good client needs from nothing until its message was taken."""
    sender = LinkSender(TokenBucket(float("inf"), 1e6), keys=KEYS, capacity_bytes=1000)
    begin_s = time.monotonic()
    try:
        sender.connect("ground", endpoint)
        sender.send("ground", END)
        assert messages.get(timeout=WAIT_S) == END
        return time.monotonic() - begin_s
    finally:
        sender.close()


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))


def settled(count: int, limit: int) -> bool:
    """Whether descriptors come back to a number, soon."""
    until_s = time.monotonic() + WAIT_S
    while descriptors() > count + limit and time.monotonic() < until_s:
        time.sleep(0.05)
    return descriptors() <= count + limit


@pytest.mark.parametrize(("first", "drip"), [(b"", b""), (HELLO, b"\x01"), (HELLO + bytes(40), b"\x02")])
def test_crowds_that_say_nothing_or_little_hold_up_nobody(inbox, first: bytes, drip: bytes) -> None:  # type: ignore[no-untyped-def]
    """1,000 connections that say nothing, and 200 that say a byte now and then, are before the door."""
    receiver, messages = inbox
    served_after_s(receiver.endpoint, messages)  # what is loaded once is loaded
    threads, open_ = threading.active_count(), descriptors()
    held = 0
    with ExitStack() as crowd:
        for index in range(1200):
            peer = crowd.enter_context(socket.create_connection(receiver.endpoint.address, timeout=WAIT_S))
            with suppress(OSError):  # it was sent away already
                peer.sendall(first if index < 200 else b"")
            if index % 100 == 99:
                with suppress(OSError):
                    peer.sendall(drip)
                assert served_after_s(receiver.endpoint, messages) < 1.0
                held = max(held, descriptors() - index - 1 - open_)
        assert held <= LinkParams().most_greeted + 8
        assert threading.active_count() <= threads + 2
    assert settled(open_, 4)
    assert set(receiver.rejected) <= {"crowded", "silent", "went_away", "not_authentic"}
    assert receiver.rejected["crowded"] > 1000


def test_strangers_hold_up_nobody_either(inbox) -> None:  # type: ignore[no-untyped-def]
    """Who knows where we listen and our key, but whose own key is not known, waits before the door too."""
    receiver, messages = inbox
    stranger = KeyPair()

    def knock() -> None:
        from pipeline.link.handshake import connect

        with suppress(Exception), socket.create_connection(receiver.endpoint.address) as peer:
            connect(peer, stranger, receiver.endpoint.key, 30.0)

    knocking = [threading.Thread(target=knock, daemon=True) for _ in range(100)]
    for thread in knocking:
        thread.start()
    assert served_after_s(receiver.endpoint, messages) < 1.0
    receiver.close()
    for thread in knocking:
        thread.join(WAIT_S)


def test_one_address_that_crowds_does_not_push_out_another() -> None:
    """127.0.0.2 says nothing, again and again; a client of 127.0.0.1 that takes its time is not sent away for it."""
    messages: queue.Queue[Message] = queue.Queue()
    params = LinkParams(most_greeted=8)
    receiver = Receiver("127.0.0.1", messages.put, keys=KEYS, peers=PEERS, params=params)
    with ExitStack() as crowd:
        slow = crowd.enter_context(socket.create_connection(receiver.endpoint.address, timeout=WAIT_S))
        for _ in range(50):
            address = receiver.endpoint.address
            crowd.enter_context(socket.create_connection(address, WAIT_S, source_address=("127.0.0.2", 0)))
        time.sleep(0.3)
        assert receiver.rejected["crowded"] >= 40
        assert slow.recv(100) == HELLO
        slow.setblocking(False)
        with pytest.raises(BlockingIOError):
            slow.recv(100)
    receiver.close()


_WITHOUT_DESCRIPTORS = """
import os, resource, socket, sys, threading, time
from pipeline.link.keys import KeyPair
from pipeline.link.receiver import Receiver

soft = 128
resource.setrlimit(resource.RLIMIT_NOFILE, (soft, soft))
messages = []
receiver = Receiver("127.0.0.1", lambda m: print("got", m.sequence, flush=True), keys=KeyPair(),
                    peers={bytes.fromhex(sys.argv[1]): "a peer"})
print(*receiver.endpoint.address, receiver.endpoint.key.hex(), flush=True)
held = []
for line in sys.stdin:
    if line == "exhaust\\n":
        try:
            while True:
                held.append(os.open("/dev/null", os.O_RDONLY))
        except OSError:
            pass
    else:
        while held:
            os.close(held.pop())
    print(len(held), threading.active_count(), flush=True)
"""


def test_a_process_without_descriptors_serves_and_hears_again() -> None:
    peer = KeyPair()
    process = subprocess.Popen(
        [sys.executable, "-c", _WITHOUT_DESCRIPTORS, peer.public.hex()],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    host, port, key = process.stdout.readline().split()
    endpoint = Endpoint(host, int(port), bytes.fromhex(key))

    def order(word: str) -> str:
        print(word, file=process.stdin, flush=True)
        return process.stdout.readline()  # type: ignore[union-attr]

    def served_s(sequence: int) -> float:
        sender = LinkSender(TokenBucket(float("inf"), 1e6), keys=peer, capacity_bytes=1000)
        begin_s = time.monotonic()
        sender.connect("ground", endpoint)
        sender.send("ground", EndOfStream("v", "d", 0, sequence))
        assert process.stdout.readline() == f"got {sequence}\n"  # type: ignore[union-attr]
        sender.close()
        return time.monotonic() - begin_s

    try:
        assert served_s(1) < 1.0
        assert int(order("exhaust").split()[0]) > 50
        with ExitStack() as crowd:
            for _ in range(300):  # silent ones beside it, more than there are descriptors
                crowd.enter_context(socket.create_connection(endpoint.address, timeout=WAIT_S))
            assert served_s(2) < 1.0
            assert served_s(3) < 1.0
        assert served_s(4) < 1.0
        order("release")
        assert served_s(5) < 1.0
    finally:
        process.kill()
        process.wait()


def test_the_crowds_of_these_tests_are_allowed() -> None:
    assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] > 1400

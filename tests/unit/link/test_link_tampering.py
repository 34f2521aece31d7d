"""Whoever sits on the wire can read nothing, change nothing, and say nothing that was said before; keys come and go."""

from __future__ import annotations

import queue
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
import pytest

from pipeline.link.backoff import BackoffParams
from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.params import LinkParams
from pipeline.link.receiver import Receiver
from pipeline.link.sender import LinkSender
from pipeline.link.token_bucket import TokenBucket
from pipeline.messages import CameraPose, Detections, EndOfStream, Message, pack
from tests.channel_ends import known_to

KEYS = KeyPair()
PEERS = {KEYS.public: "a peer"}
WAIT_S = 20.0
MARKER = "a stream that nobody may know of"
Change = Callable[[int, bytes], bytes]


class OnTheWire:
    """Passes on what it changes; said: all that it has seen, by direction (0: to the receiver)."""

    def __init__(self, target: tuple[str, int], change: Change = lambda _, data: data) -> None:
        self.said = [bytearray(), bytearray()]
        self._target, self._change = target, change
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = self._listener.getsockname()
        self._ends: list[socket.socket] = [self._listener]
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        for end in self._ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            far = socket.create_connection(self._target)
            self._ends += [near, far]
            for direction, (source, sink) in enumerate(((near, far), (far, near))):
                threading.Thread(target=self._pass, args=(direction, source, sink), daemon=True).start()

    def _pass(self, direction: int, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                self.said[direction] += data
                sink.sendall(self._change(direction, data))
            sink.shutdown(socket.SHUT_WR)


def result(index: int) -> Detections:
    pose = CameraPose(np.zeros(3), np.eye(3))
    return Detections(
        MARKER, "d", index, index, pose, np.zeros((1, 4)), np.array([0.25]), np.zeros(1, dtype=np.int64)
    )


@pytest.fixture
def inbox() -> Iterator[tuple[Receiver, queue.Queue[Message]]]:
    messages: queue.Queue[Message] = queue.Queue()
    receiver = Receiver("127.0.0.1", messages.put, keys=KEYS, peers=PEERS)
    yield receiver, messages
    receiver.close()


def through(receiver: Receiver, change: Change) -> tuple[OnTheWire, Endpoint]:
    wire = OnTheWire(receiver.endpoint.address, change)
    return wire, Endpoint(*wire.address[:2], receiver.endpoint.key)


def test_neither_names_nor_scores_nor_keys_are_seen_on_the_wire(inbox) -> None:  # type: ignore[no-untyped-def]
    receiver, messages = inbox
    wire, endpoint = through(receiver, lambda _, data: data)
    asked: queue.Queue[tuple[str, str]] = queue.Queue()
    sender = LinkSender(
        TokenBucket(float("inf"), 1e6),
        keys=KEYS,
        capacity_bytes=10**6,
        on_restart=lambda *what: asked.put(what),
    )
    sender.connect("ground", endpoint)
    for index in range(5):
        sender.send("ground", result(index))
        assert messages.get(timeout=WAIT_S).index == index  # type: ignore[union-attr]
    sender.send("ground", EndOfStream(MARKER, "d"))
    messages.get(timeout=WAIT_S)
    receiver.want_restart(MARKER, "d")
    assert asked.get(timeout=WAIT_S) == (MARKER, "d")
    sender.close()
    wire.close()
    for said in wire.said:
        assert len(said) > 100
        for secret in (
            MARKER.encode(),
            np.array([0.25]).tobytes(),
            np.eye(3).tobytes(),
            KEYS.public,
            KEYS.private.private_bytes_raw(),
        ):
            assert secret not in said


def flipped(at: int) -> Change:
    """One bit of what goes to the receiver, so many bytes after the handshake (5 + 96 + 20 bytes)."""
    passed = 0

    def change(direction: int, data: bytes) -> bytes:
        nonlocal passed
        begin, passed = passed, passed + len(data) * (direction == 0)
        place = 121 + at - begin
        if direction or not 0 <= place < len(data):
            return data
        return data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]

    return change


@pytest.mark.parametrize("at", [3, 4, 50, 200, 300])
def test_a_changed_bit_ends_the_connection_and_nothing_of_it_is_taken(inbox, at: int) -> None:  # type: ignore[no-untyped-def]
    receiver, messages = inbox
    wire, endpoint = through(receiver, flipped(at))
    broken: queue.Queue[str] = queue.Queue()
    sender = LinkSender(
        TokenBucket(float("inf"), 1e6),
        keys=KEYS,
        capacity_bytes=10**6,
        on_lost=lambda _, reason: broken.put(reason),
    )
    sender.connect("ground", endpoint)
    for index in range(20):
        with suppress(ConnectionError):
            sender.send("ground", result(index))
    broken.get(timeout=WAIT_S)
    sender.close()
    wire.close()
    until_s = time.monotonic() + WAIT_S
    while not receiver.rejected and time.monotonic() < until_s:
        time.sleep(0.01)
    assert sum(receiver.rejected.values()) == 1
    assert set(receiver.rejected) <= {"not_authentic", "bad_length", "cut"}
    got = [messages.get().index for _ in range(messages.qsize())]  # type: ignore[union-attr]
    assert got == list(range(len(got))), "what came before it, and that alone"
    assert len(got) <= 1


def test_what_was_said_once_cannot_be_said_again(inbox) -> None:  # type: ignore[no-untyped-def]
    """A whole connection, recorded and played again, hello and all: it gets no further than the first answer."""
    receiver, messages = inbox
    wire, endpoint = through(receiver, lambda _, data: data)
    sender = LinkSender(TokenBucket(float("inf"), 1e6), keys=KEYS, capacity_bytes=10**6)
    sender.connect("ground", endpoint)
    sender.send("ground", result(1))
    assert messages.get(timeout=WAIT_S).index == 1  # type: ignore[union-attr]
    sender.close()
    wire.close()
    before = receiver.rejected.get("not_authentic", 0)
    with socket.create_connection(receiver.endpoint.address, timeout=WAIT_S) as replay:
        replay.sendall(wire.said[0])
        with suppress(OSError):
            while replay.recv(1000):
                pass
    until_s = time.monotonic() + WAIT_S
    while receiver.rejected.get("not_authentic", 0) == before and time.monotonic() < until_s:
        time.sleep(0.01)
    assert receiver.rejected["not_authentic"] == before + 1
    assert messages.empty()


def test_a_forged_record_put_in_between_ends_the_connection(inbox) -> None:  # type: ignore[no-untyped-def]
    """As the relay of the first house did, which put a detection of its own into an authenticated connection."""
    receiver, messages = inbox
    forged = (
        len(result(0).stream).to_bytes(4, "big") + b"\x94\x01 a detection of score .99 ..................."
    )
    for forged in (b"\0\0\0\x30" + bytes(48), b"\0\0\0\x14" + b"\x94\x01\xa7forged-" + bytes(9)):
        peer, session = known_to(receiver.endpoint, KEYS)
        with peer:
            peer.sendall(session.writer.seal(pack(result(7))))
            assert messages.get(timeout=WAIT_S).index == 7  # type: ignore[union-attr]
            peer.sendall(forged + session.writer.seal(pack(result(8))))
            with suppress(OSError):
                while peer.recv(1000):
                    pass
    assert receiver.rejected == {"not_authentic": 2}
    assert messages.empty()


def test_feedback_that_is_forged_is_not_believed(inbox) -> None:  # type: ignore[no-untyped-def]
    """Else a relay could say that all was read, and nothing would be sent again."""
    receiver, _ = inbox
    passed = 0

    def change(direction: int, data: bytes) -> bytes:
        nonlocal passed
        passed += len(data) * direction
        return bytes(len(data)) if direction and passed > 53 + 5 else data

    wire, endpoint = through(receiver, change)
    broken: queue.Queue[str] = queue.Queue()
    sender = LinkSender(
        TokenBucket(float("inf"), 1e6),
        keys=KEYS,
        capacity_bytes=10**6,
        on_lost=lambda _, reason: broken.put(reason),
    )
    sender.connect("ground", endpoint)
    sender.send("ground", result(1))
    assert "record of 0 bytes" in broken.get(timeout=WAIT_S)
    sender.close()
    wire.close()


def test_a_revoked_key_is_cut_off_at_once_and_for_good_and_others_stay() -> None:
    messages: queue.Queue[Message] = queue.Queue()
    lost_drone, other = KeyPair(), KeyPair()
    peers = {lost_drone.public: "source:a", other.public: "source:b"}
    receiver = Receiver("127.0.0.1", messages.put, keys=KEYS, peers=peers)
    params = LinkParams(backoff=BackoffParams(0.01, 0.02))
    senders = [
        LinkSender(
            TokenBucket(float("inf"), 1e6), keys=keys, capacity_bytes=10**6, params=params, reconnect=True
        )
        for keys in (lost_drone, other)
    ]
    for index, sender in enumerate(senders):
        sender.connect("ground", receiver.endpoint)
        sender.send("ground", result(index))
        assert messages.get(timeout=WAIT_S).index == index  # type: ignore[union-attr]
    receiver.accept_only({other.public: "source:b"})
    until_s = time.monotonic() + WAIT_S
    while receiver.rejected.get("revoked", 0) < 3 and time.monotonic() < until_s:
        time.sleep(0.01)
    assert receiver.rejected["revoked"] >= 3, "it tried again and again"
    assert not senders[0].is_up("ground")
    assert senders[1].is_up("ground")
    senders[1].send("ground", result(5))
    assert messages.get(timeout=WAIT_S).index == 5  # type: ignore[union-attr]
    for sender in senders:
        sender.close()
    receiver.close()


def test_keys_are_changed_while_it_runs_and_no_message_is_lost() -> None:
    messages: queue.Queue[Message] = queue.Queue()
    old, new = KeyPair(), KeyPair()
    receiver = Receiver("127.0.0.1", messages.put, keys=KEYS, peers={old.public: "source:a"})
    first = LinkSender(TokenBucket(float("inf"), 1e6), keys=old, capacity_bytes=10**6)
    first.connect("ground", receiver.endpoint)
    first.send("ground", result(0))
    receiver.accept_only({old.public: "source:a", new.public: "source:a"})
    second = LinkSender(TokenBucket(float("inf"), 1e6), keys=new, capacity_bytes=10**6)
    second.connect("ground", receiver.endpoint)
    second.send("ground", result(1))
    first.send("ground", result(2))
    assert first.flush(WAIT_S)
    receiver.accept_only({new.public: "source:a"})
    second.send("ground", result(3))
    got = {messages.get(timeout=WAIT_S).index for _ in range(4)}  # type: ignore[union-attr]
    assert got == {0, 1, 2, 3}
    for end in (first, second, receiver):
        end.close()

"""Messages arrive whole, in order, at the link's pace, and only from those whose key is known."""

import math
import queue
import socket
import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from pipeline.clock import Clock
from pipeline.errors import ProtocolError
from pipeline.link import handshake
from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.params import LinkParams
from pipeline.link.receiver import Receiver
from pipeline.link.records import record_bytes
from pipeline.link.sender import LinkSender
from pipeline.link.token_bucket import TokenBucket
from pipeline.messages import (
    WIRE_VERSION,
    CameraPose,
    Dropped,
    EndOfStream,
    Message,
    Packet,
    pack,
)
from tests.channel_ends import known_to

KEYS = KeyPair()
PEERS = {KEYS.public: "a peer"}
WAIT_S = 20.0


class FakeTime:
    """A clock that only sleeping moves; safe to read from any thread."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def clock(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


#: for made-up clocks, which say nothing about how long the far end is silent
PATIENT = LinkParams(silence_s=1e8, broken_s=1e9)


def dropped(index: int, reason: str = "late") -> Dropped:
    return Dropped("drone-1", "small", index, 1_000 * index, reason)


def packet(nbytes: int) -> Packet:
    pose = CameraPose(np.arange(3.0), np.eye(3))
    return Packet("drone-1", "small", 0, 0, 0, 1, 30, True, pose, bytes(nbytes))


def wire_bytes(message: Message) -> int:
    return record_bytes(pack(message))


@pytest.fixture
def inbox() -> Iterator[tuple[Receiver, "queue.Queue[Message]"]]:
    messages: queue.Queue[Message] = queue.Queue()
    receiver = Receiver("127.0.0.1", messages.put, keys=KEYS, peers=PEERS)
    yield receiver, messages
    receiver.close()


@pytest.fixture
def link() -> Iterator[Callable[..., LinkSender]]:
    senders: list[LinkSender] = []

    def make(
        rate_bps: float = math.inf, burst_bytes: int = 4096, capacity_bytes: int = 10**6, **more: object
    ) -> LinkSender:
        bucket = TokenBucket(rate_bps, burst_bytes)
        senders.append(LinkSender(bucket, capacity_bytes=capacity_bytes, **{"keys": KEYS, **more}))  # type: ignore[arg-type]
        return senders[-1]

    yield make
    for sender in senders:
        sender.close()


def eventually(condition: Callable[[], bool]) -> bool:
    """Poll; how long it takes is not part of any test."""
    wait = threading.Event()
    return any(condition() or wait.wait(0.01) for _ in range(int(WAIT_S / 0.01)))


def until_closed(peer: socket.socket) -> bool:
    """Read what the receiver says back, to its end."""
    while peer.recv(1000):
        pass
    return True


def test_messages_arrive_as_they_were_and_in_order(inbox, link) -> None:  # type: ignore[no-untyped-def]
    receiver, messages = inbox
    sender = link()
    sender.connect("ground", receiver.endpoint)
    for index in range(200):
        assert sender.send("ground", dropped(index))
    sender.send("ground", packet(3_000_000))
    assert [messages.get(timeout=WAIT_S) for _ in range(200)] == [dropped(index) for index in range(200)]
    received = messages.get(timeout=WAIT_S)
    assert isinstance(received, Packet)
    assert received.data == bytes(3_000_000)
    np.testing.assert_array_equal(received.pose.position_enu, np.arange(3.0))
    assert sender.flush(WAIT_S)
    assert sender.bytes_sent == sum(wire_bytes(dropped(i)) for i in range(200)) + wire_bytes(
        packet(3_000_000)
    )


def test_two_connections_share_the_link_and_each_gets_its_own(link) -> None:  # type: ignore[no-untyped-def]
    boxes: list[queue.Queue[Message]] = [queue.Queue(), queue.Queue()]
    receivers = [Receiver("127.0.0.1", box.put, keys=KEYS, peers=PEERS) for box in boxes]
    sender = link()
    for name, receiver in zip("ab", receivers, strict=True):
        sender.connect(name, receiver.endpoint)
    for index in range(50):
        sender.send("ab"[index % 2], dropped(index))
    for parity, box in enumerate(boxes):
        assert [box.get(timeout=WAIT_S).index for _ in range(25)] == list(range(parity, 50, 2))  # type: ignore[union-attr]
    for receiver in receivers:
        receiver.close()


def test_the_bytes_on_the_wire_take_the_time_that_the_link_needs(inbox, link) -> None:  # type: ignore[no-untyped-def]
    receiver, _ = inbox
    time, rate_bps, burst_bytes = FakeTime(), 1e6, 5000
    sender = link(rate_bps, burst_bytes, params=PATIENT, clock=Clock(time.clock, time.sleep))
    sender.connect("ground", receiver.endpoint)
    total = 0
    for index in range(10):
        message = packet(25_000 + index)
        total += wire_bytes(message)
        sender.send("ground", message)
    assert sender.flush(WAIT_S)
    assert sender.bytes_sent == total
    assert time.now_s == pytest.approx((total - burst_bytes) * 8 / rate_bps)


def test_a_large_message_takes_the_link_evenly(inbox, link) -> None:  # type: ignore[no-untyped-def]
    receiver, _ = inbox
    time, naps = FakeTime(), []
    rate_bps, burst_bytes = 1e6, 5000

    def sleep(seconds: float) -> None:
        naps.append(seconds)
        time.sleep(seconds)

    sender = link(rate_bps, burst_bytes, params=PATIENT, clock=Clock(time.clock, sleep))
    sender.connect("ground", receiver.endpoint)
    sender.send("ground", packet(100_000))
    assert sender.flush(WAIT_S)
    assert len(naps) > 50
    assert max(naps) <= 0.011


def test_the_backlog_is_the_link_time_of_what_waits(link, inbox) -> None:  # type: ignore[no-untyped-def]
    receiver, _ = inbox
    gate = threading.Event()
    sender = link(1e6, 1000, params=PATIENT, clock=Clock(lambda: 0.0, lambda _: gate.wait(WAIT_S)))
    sender.connect("ground", receiver.endpoint)
    assert sender.backlog_s() == 0.0
    sender.send("ground", packet(50_000))
    assert sender.backlog_s() == pytest.approx(wire_bytes(packet(50_000)) * 8 / 1e6, rel=0.05)
    gate.set()


def test_a_full_queue_blocks_and_a_sender_in_no_mood_to_wait_is_told(inbox, link) -> None:  # type: ignore[no-untyped-def]
    receiver, messages = inbox
    gate = threading.Event()
    sender = link(8e3, 1000, capacity_bytes=2000, clock=Clock(sleep=lambda _: gate.wait(WAIT_S)))
    sender.connect("ground", receiver.endpoint)
    assert sender.send("ground", packet(50_000), timeout_s=0)  # larger than the queue, which is empty
    assert not sender.send("ground", dropped(1), timeout_s=0)
    assert not sender.send("ground", dropped(1), timeout_s=0.05)
    assert not sender.flush(0.05)
    threading.Timer(0.05, gate.set).start()
    assert sender.send("ground", dropped(2))
    assert isinstance(messages.get(timeout=WAIT_S), Packet)
    assert messages.get(timeout=WAIT_S) == dropped(2)


def test_a_receiver_that_does_not_take_messages_holds_up_its_sender(link) -> None:  # type: ignore[no-untyped-def]
    gate, taken = threading.Event(), []

    def slow(message: Message) -> None:
        gate.wait(WAIT_S)
        taken.append(message)

    receiver = Receiver("127.0.0.1", slow, keys=KEYS, peers=PEERS)
    sender = link(capacity_bytes=1_000_000)
    sender.connect("ground", receiver.endpoint)
    sent = 0
    while sender.send("ground", packet(300_000), timeout_s=0.3):
        sent += 1
        assert sent < 500, "nothing holds the sender up"
    gate.set()
    assert sender.flush(WAIT_S)
    assert eventually(lambda: len(taken) == sent)
    receiver.close()


def test_a_key_that_nobody_knows_is_refused_at_both_ends(link) -> None:  # type: ignore[no-untyped-def]
    messages: queue.Queue[Message] = queue.Queue()
    receiver = Receiver("127.0.0.1", messages.put, keys=KEYS, peers=PEERS, params=LinkParams(connect_s=0.3))
    with pytest.raises((ProtocolError, ConnectionError)):
        link(keys=KeyPair()).connect("ground", receiver.endpoint)
    assert eventually(lambda: receiver.rejected == {"unknown_key": 1})
    assert messages.empty()
    receiver.close()


def test_a_key_that_becomes_known_within_the_time_limit_is_let_in(inbox, link) -> None:  # type: ignore[no-untyped-def]
    receiver, messages = inbox
    keys = KeyPair()
    threading.Timer(0.2, receiver.accept_only, ({keys.public: "late"},)).start()
    sender = link(keys=keys)
    sender.connect("ground", receiver.endpoint)
    sender.send("ground", dropped(1))
    assert messages.get(timeout=WAIT_S) == dropped(1)
    assert receiver.rejected == {}


def test_a_server_that_is_another_gets_no_message(inbox, link) -> None:  # type: ignore[no-untyped-def]
    receiver, messages = inbox
    host, port = receiver.endpoint.address
    with pytest.raises((ProtocolError, ConnectionError)):
        link().connect("ground", Endpoint(host, port, KeyPair().public))
    assert eventually(lambda: receiver.rejected == {"not_authentic": 1})
    with socket.create_server(("127.0.0.1", 0)) as server:

        def pretend() -> None:
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"SLNK" + bytes([WIRE_VERSION]) + bytes(48))
                connection.recv(200)

        threading.Thread(target=pretend, daemon=True).start()
        with pytest.raises(ProtocolError):
            link().connect("ground", Endpoint(*server.getsockname()[:2], KEYS.public))
    assert messages.empty()


@pytest.mark.parametrize("junk", [b"\x80\x04\x95pickle", b"\x91\x09", b"\xc1" * 30, b"\xff" * 4])
def test_bytes_that_are_no_message_close_the_connection_and_are_counted(inbox, junk: bytes) -> None:  # type: ignore[no-untyped-def]
    receiver, messages = inbox
    peer, session = known_to(receiver.endpoint, KEYS)
    with peer:
        peer.sendall(session.writer.seal(pack(EndOfStream("drone-1", "small"))))
        assert messages.get(timeout=WAIT_S) == EndOfStream("drone-1", "small")
        peer.sendall(session.writer.seal(junk))
        assert until_closed(peer)
    assert receiver.rejected == {"not_a_message": 1}
    assert messages.empty()


def test_what_is_not_sealed_closes_the_connection_and_is_counted(inbox) -> None:  # type: ignore[no-untyped-def]
    receiver, messages = inbox
    for junk, reason in (
        (pack(dropped(1)).rjust(64, b"\0"), "bad_length"),
        (b"\0\0\0\x40" + bytes(64), "not_authentic"),
    ):
        peer, _ = known_to(receiver.endpoint, KEYS)
        with peer:
            peer.sendall(junk)
            assert until_closed(peer)
        assert eventually(lambda reason=reason: receiver.rejected.get(reason) == 1)
    assert messages.empty()


def test_a_connection_that_ends_within_a_record_is_counted(inbox) -> None:  # type: ignore[no-untyped-def]
    receiver, messages = inbox
    peer, session = known_to(receiver.endpoint, KEYS)
    with peer:
        peer.sendall(session.writer.seal(pack(dropped(1)))[:-1])
    assert eventually(lambda: receiver.rejected == {"cut": 1})
    assert messages.empty()


def test_a_peer_that_skips_the_handshake_is_not_heard(inbox) -> None:  # type: ignore[no-untyped-def]
    receiver, messages = inbox
    with socket.create_connection(receiver.endpoint.address, timeout=WAIT_S) as peer:
        peer.recv(5)
        peer.sendall(pack(dropped(1)).ljust(102, b"\0"))
        assert eventually(lambda: receiver.rejected == {"version": 1})
    with socket.create_connection(receiver.endpoint.address, timeout=WAIT_S) as peer:
        peer.sendall(handshake.HELLO + pack(dropped(1)).ljust(102, b"\0"))
        assert eventually(lambda: receiver.rejected == {"version": 1, "not_authentic": 1})
    assert messages.empty()


def test_one_key_has_so_many_connections_and_no_more(link) -> None:  # type: ignore[no-untyped-def]
    params = LinkParams(most_connections=3)
    receiver = Receiver("127.0.0.1", lambda _: None, keys=KEYS, peers=PEERS, params=params)
    sender = link()
    for name in "abc":
        sender.connect(name, receiver.endpoint)
    link().connect("d", receiver.endpoint)
    assert eventually(lambda: receiver.rejected == {"too_many": 1})
    receiver.close()


def test_a_broken_connection_is_reported_counted_and_can_be_made_again(link) -> None:  # type: ignore[no-untyped-def]
    gate = threading.Event()
    first = Receiver("127.0.0.1", lambda _: None, keys=KEYS, peers=PEERS)
    told: queue.Queue[tuple[str, str]] = queue.Queue()
    sender = link(
        8e3, 1000, clock=Clock(sleep=lambda _: gate.wait(WAIT_S)), on_lost=lambda *what: told.put(what)
    )
    sender.connect("ground", first.endpoint)
    sender.send("ground", dropped(0))
    assert sender.flush(WAIT_S)
    sender.send("ground", packet(5_000))  # more than the bucket holds
    sender.send("ground", dropped(1))
    first.close()
    assert told.get(timeout=WAIT_S) == ("ground", "closed by the receiver")
    gate.set()
    assert isinstance(sender.error, OSError)
    assert sender.lost == 2
    assert [m.index for m in sender.take_lost()] == [0, 1]
    assert sender.take_lost() == []
    assert sender.state().down == {"ground": "closed by the receiver"}
    assert not sender.is_up("ground")
    with pytest.raises(ConnectionError, match="link 'ground': closed by the receiver"):
        sender.send("ground", dropped(2))
    messages: queue.Queue[Message] = queue.Queue()
    second = Receiver("127.0.0.1", messages.put, keys=KEYS, peers=PEERS)
    sender.connect("ground", second.endpoint)
    assert sender.error is None
    assert sender.is_up("ground")
    sender.send("ground", dropped(3))
    assert messages.get(timeout=WAIT_S) == dropped(3)
    second.close()


def test_one_broken_connection_leaves_the_others_alone(inbox, link) -> None:  # type: ignore[no-untyped-def]
    receiver, messages = inbox
    gone = Receiver("127.0.0.1", lambda _: None, keys=KEYS, peers=PEERS)
    sender = link()
    sender.connect("gone", gone.endpoint)
    sender.connect("ground", receiver.endpoint)
    gone.close()
    assert eventually(lambda: not sender.is_up("gone"))
    sender.send("ground", dropped(1))
    assert messages.get(timeout=WAIT_S) == dropped(1)


def test_an_exception_of_the_taker_closes_the_connection_and_is_kept(link) -> None:  # type: ignore[no-untyped-def]
    def fail(_: Message) -> None:
        raise RuntimeError("no room in the house")

    receiver = Receiver("127.0.0.1", fail, keys=KEYS, peers=PEERS)
    sender = link()
    sender.connect("ground", receiver.endpoint)
    sender.send("ground", dropped(0))
    assert eventually(lambda: isinstance(receiver.error, RuntimeError))
    assert receiver.rejected == {}
    receiver.close()


def test_sending_nowhere_or_after_the_end_is_an_error_and_closing_wakes_who_waits(inbox, link) -> None:  # type: ignore[no-untyped-def]
    receiver, _ = inbox
    sender = link(8e3, 1000, capacity_bytes=2000, clock=Clock(sleep=lambda _: threading.Event().wait(0.05)))
    with pytest.raises(ConnectionError):
        sender.send("ground", dropped(0))
    sender.connect("ground", receiver.endpoint)
    sender.send("ground", packet(50_000))
    threading.Timer(0.05, sender.close).start()
    with pytest.raises(ConnectionError, match="closed"):
        sender.send("ground", packet(50_000))

"""A link on loopback that is worse than declared, stands still, or breaks: known, counted, and within its time."""

from __future__ import annotations

import multiprocessing
import os
import queue
import re
import signal
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.connection import Connection

import numpy as np
import pytest

from pipeline.errors import ProtocolError
from pipeline.link import handshake
from pipeline.link.backoff import BackoffParams
from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.params import LinkParams
from pipeline.link.receiver import Receiver
from pipeline.link.sender import LinkSender
from pipeline.link.token_bucket import TokenBucket
from pipeline.messages import WIRE_VERSION, CameraPose, Message, Packet
from pipeline.mission.stages.virtual_link import burst_bytes
from tests.channel_ends import greet
from tests.integration.throttled_relay import ThrottledRelay

KEYS = KeyPair()
PEERS = {KEYS.public: "a peer"}
WAIT_S = 20.0
DECLARED_BPS, OFFERED_BPS, FRAME_HZ = 6e6, 4e6, 10.0
_POSE = CameraPose(np.zeros(3), np.eye(3))


def packet(index: int, nbytes: int, detector: str = "d") -> Packet:
    return Packet("drone", detector, index, 0, 0, 1, 10, False, _POSE, bytes(nbytes))


@pytest.fixture
def ends() -> Iterator[Callable[..., tuple[LinkSender, ThrottledRelay, queue.Queue[Message]]]]:
    closing: list[LinkSender | ThrottledRelay | Receiver] = []

    def make(real_bps: float, **more: object) -> tuple[LinkSender, ThrottledRelay, queue.Queue[Message]]:
        inbox: queue.Queue[Message] = queue.Queue()
        receiver = Receiver("127.0.0.1", inbox.put, keys=KEYS, peers=PEERS)
        relay = ThrottledRelay(receiver.endpoint.address, real_bps)
        bucket = TokenBucket(DECLARED_BPS, burst_bytes(DECLARED_BPS))
        sender = LinkSender(bucket, keys=KEYS, capacity_bytes=4_000_000, **more)  # type: ignore[arg-type]
        closing.extend((sender, relay, receiver))
        sender.connect("ground", Endpoint(*relay.address, KEYS.public))
        return sender, relay, inbox

    yield make
    for end in closing:
        end.close()


def offer(sender: LinkSender, seconds: float, bps: float = OFFERED_BPS) -> None:
    """Frames at their times; none while the link is more than a second behind."""
    begin_s = time.monotonic()
    for index in range(round(seconds * FRAME_HZ)):
        time.sleep(max(0.0, begin_s + index / FRAME_HZ - time.monotonic()))
        if sender.backlog_s() <= 1.0:
            sender.send("ground", packet(index, round(bps / FRAME_HZ / 8)), timeout_s=0)


@pytest.mark.parametrize(
    "real_bps", [pytest.param(3e6, marks=pytest.mark.slow), 1e6, pytest.param(0.5e6, marks=pytest.mark.slow)]
)
def test_declared_6_offered_4_the_estimate_is_the_real_rate_2_s_after_the_change_both_ways(
    ends, real_bps: float
) -> None:  # type: ignore[no-untyped-def]
    sender, relay, _ = ends(50e6)
    offer(sender, 1.5)
    assert sender.state().rate_bps == pytest.approx(6e6, rel=0.1)
    relay.rate_bps = real_bps
    offer(sender, 2.0)
    state = sender.state()
    passed_bps = relay.passed_bps(1.2)
    assert (
        0.0 < passed_bps < 1.1 * real_bps
    )  # on a busy machine the relay's thread is late, and lets less through
    assert state.rate_bps == pytest.approx(passed_bps, rel=0.1)
    assert state.full
    assert state.backlog_s == pytest.approx(state.unread_bytes * 8 / passed_bps, rel=0.15)
    relay.rate_bps = 50e6
    offer(sender, 2.0)
    assert sender.state().rate_bps >= 0.9 * OFFERED_BPS
    assert not sender.state().full


def test_little_offered_on_a_good_link_leaves_the_declared_rate(ends) -> None:  # type: ignore[no-untyped-def]
    sender, _, _ = ends(50e6)
    offer(sender, 2.0, bps=0.2e6)
    assert sender.state().rate_bps == DECLARED_BPS
    assert sender.backlog_s() < 0.1


def test_a_silent_link_is_known_within_two_seconds_and_so_is_its_return(ends) -> None:  # type: ignore[no-untyped-def]
    told: queue.Queue[tuple[str, str]] = queue.Queue()
    back: queue.Queue[str] = queue.Queue()
    sender, relay, inbox = ends(50e6, on_lost=lambda *what: told.put(what), on_back=back.put)
    sender.send("ground", packet(0, 1000))
    inbox.get(timeout=WAIT_S)
    relay.stop_back = True
    stopped_s = time.monotonic()
    assert told.get(timeout=WAIT_S) == ("ground", "silent for 1 s")
    assert 0.7 < time.monotonic() - stopped_s < 2.0
    assert not sender.is_up("ground")
    assert sender.state().down == {"ground": "silent"}
    relay.stop_back = False
    assert back.get(timeout=WAIT_S) == "ground"
    assert sender.is_up("ground")
    assert sender.lost == 0


def test_a_connection_that_stays_silent_is_broken_and_its_messages_are_lost(ends) -> None:  # type: ignore[no-untyped-def]
    told: queue.Queue[tuple[str, str]] = queue.Queue()
    params = LinkParams(silence_s=0.5, broken_s=1.0)
    sender, relay, _ = ends(50e6, params=params, on_lost=lambda *what: told.put(what))
    relay.rate_bps, relay.stop_back = 0.0, True
    sender.send("ground", packet(7, 1000))
    assert told.get(timeout=WAIT_S) == ("ground", "silent for 0.5 s")
    assert told.get(timeout=WAIT_S) == ("ground", "silent for 1 s")
    assert [m.index for m in sender.take_lost()] == [7]
    assert sender.backlog_s() == 0.0


def test_a_link_that_was_cut_is_made_again_after_a_wait_and_goes_on(ends) -> None:  # type: ignore[no-untyped-def]
    told: queue.Queue[tuple[str, str]] = queue.Queue()
    back: queue.Queue[str] = queue.Queue()
    params = LinkParams(backoff=BackoffParams(first_s=0.05, most_s=0.2))
    sender, relay, inbox = ends(
        50e6, params=params, reconnect=True, on_lost=lambda *what: told.put(what), on_back=back.put
    )
    sender.send("ground", packet(0, 1000))
    assert inbox.get(timeout=WAIT_S).index == 0  # type: ignore[union-attr]
    assert sender.flush(WAIT_S)
    relay.cut()
    assert told.get(timeout=WAIT_S)[0] == "ground"
    assert back.get(timeout=WAIT_S) == "ground"
    assert sender.error is None
    sender.send("ground", packet(1, 1000))
    assert inbox.get(timeout=WAIT_S).index == 1  # type: ignore[union-attr]


def test_a_receiver_that_stops_reading_does_not_hold_the_link_that_another_shares() -> None:
    inbox: queue.Queue[Message] = queue.Queue()
    gate = threading.Event()
    stopped = Receiver("127.0.0.1", lambda _: gate.wait(WAIT_S) and None, keys=KEYS, peers=PEERS)
    going = Receiver("127.0.0.1", inbox.put, keys=KEYS, peers=PEERS)
    sender = LinkSender(TokenBucket(20e6, burst_bytes(20e6)), keys=KEYS, capacity_bytes=1_000_000)
    sender.connect("stopped", stopped.endpoint)
    sender.connect("going", going.endpoint)
    refused = 0
    for index in range(200):
        refused += not sender.send("stopped", packet(index, 100_000, "stopped"), timeout_s=0)
        sender.send("going", packet(index, 1_000, "going"), timeout_s=WAIT_S)
        time.sleep(0.01)
    assert [inbox.get(timeout=WAIT_S).index for _ in range(200)] == list(range(200))  # type: ignore[union-attr]
    assert refused > 0
    gate.set()
    for end in (sender, stopped, going):
        end.close()


def receive(pipe: Connection, peer: bytes) -> None:
    """In another process: sends the number of each packet that comes from who has this key."""
    receiver = Receiver(
        "127.0.0.1", lambda message: pipe.send(message.index), keys=KEYS, peers={peer: "a peer"}
    )  # type: ignore[union-attr]
    pipe.send(receiver.endpoint)
    threading.Event().wait()


def test_a_stopped_process_is_known_within_two_seconds_holds_nobody_up_and_goes_on_where_it_was() -> None:
    spawn = multiprocessing.get_context("spawn")
    told: queue.Queue[tuple[str, str]] = queue.Queue()
    back: queue.Queue[str] = queue.Queue()
    sender = LinkSender(
        TokenBucket(20e6, burst_bytes(20e6)),
        keys=KEYS,
        capacity_bytes=10_000_000,
        on_lost=lambda *what: told.put(what),
        on_back=back.put,
    )
    ours = {}
    processes = []
    for name in ("stopped", "going"):
        ours[name], theirs = spawn.Pipe()
        processes.append(spawn.Process(target=receive, args=(theirs, KEYS.public), daemon=True))
        processes[-1].start()
        sender.connect(name, ours[name].recv())
    try:
        pid = processes[0].pid
        assert pid is not None
        os.kill(pid, signal.SIGSTOP)
        stopped_s = time.monotonic()
        for index in range(100):
            sender.send("stopped", packet(index, 20_000), timeout_s=0)
            sender.send("going", packet(index, 1_000), timeout_s=0)
            assert ours["going"].poll(WAIT_S)
            assert ours["going"].recv() == index
        name, reason = told.get(timeout=WAIT_S)
        assert (name, reason) == ("stopped", "silent for 1 s")
        assert time.monotonic() - stopped_s < 2.0
        assert sender.is_up("going")
        os.kill(pid, signal.SIGCONT)
        assert [ours["stopped"].recv() for _ in range(100)] == list(range(100))
        assert back.get(timeout=WAIT_S) == "stopped"
        assert sender.lost == 0
    finally:
        for process in processes:
            process.kill()
        sender.close()


def test_a_peer_that_says_hello_and_no_more_costs_the_time_limit_and_no_more() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        sender = LinkSender(
            TokenBucket(1e6, 1e4), keys=KEYS, capacity_bytes=1000, params=LinkParams(connect_s=0.3)
        )
        begin_s = time.monotonic()
        with pytest.raises(OSError, match="time"):
            sender.connect("ground", Endpoint(*server.getsockname()[:2], KEYS.public))
        assert time.monotonic() - begin_s < 2.0
        sender.close()


def test_a_sender_that_connects_and_no_more_loses_its_connection_in_time() -> None:
    receiver = Receiver("127.0.0.1", lambda _: None, keys=KEYS, peers=PEERS, params=LinkParams(connect_s=0.3))
    with socket.create_connection(receiver.endpoint.address) as peer:
        peer.settimeout(WAIT_S)
        begin_s = time.monotonic()
        while peer.recv(1000):
            pass
        assert time.monotonic() - begin_s < 2.0
    receiver.close()


def test_a_sender_that_falls_silent_is_reported_by_its_receiver_with_its_name_and_then_closed() -> None:
    told: queue.Queue[tuple[str, str]] = queue.Queue()
    params = LinkParams(silence_s=0.4, broken_s=1.0)
    receiver = Receiver(
        "127.0.0.1",
        lambda _: None,
        keys=KEYS,
        peers=PEERS,
        params=params,
        on_lost=lambda *what: told.put(what),
    )
    with socket.create_connection(receiver.endpoint.address) as peer:
        handshake.connect(peer, KEYS, receiver.endpoint.key)
        assert told.get(timeout=WAIT_S) == ("a peer", "silent for 0.4 s")
        assert told.get(timeout=WAIT_S) == ("a peer", "silent for 1 s")
    receiver.close()


def test_an_idle_link_is_not_silent_at_either_end() -> None:
    told: list[tuple[str, str]] = []
    params = LinkParams(heartbeat_s=0.1, silence_s=2.0)
    receiver = Receiver(
        "127.0.0.1",
        lambda _: None,
        keys=KEYS,
        peers=PEERS,
        params=params,
        on_lost=lambda *what: told.append(what),
    )
    sender = LinkSender(
        TokenBucket(1e6, 1e4),
        keys=KEYS,
        capacity_bytes=1000,
        params=params,
        on_lost=lambda *what: told.append(what),
    )
    sender.connect("ground", receiver.endpoint)
    time.sleep(3.0)
    assert told == []
    assert sender.is_up("ground")
    assert sender.bytes_sent == 0
    receiver.close()
    sender.close()


def test_a_receiver_asks_for_a_new_beginning_of_one_substream() -> None:
    asked: queue.Queue[tuple[str, str]] = queue.Queue()

    def refuse(message: Message) -> None:
        assert isinstance(message, Packet)
        receiver.want_restart(message.stream, message.detector)

    receiver = Receiver("127.0.0.1", refuse, keys=KEYS, peers=PEERS)
    sender = LinkSender(
        TokenBucket(1e6, 1e4), keys=KEYS, capacity_bytes=10_000, on_restart=lambda *what: asked.put(what)
    )
    sender.connect("ground", receiver.endpoint)
    sender.send("ground", packet(0, 100, "ground-pc:größe"))
    assert asked.get(timeout=WAIT_S) == ("drone", "ground-pc:größe")
    receiver.close()
    sender.close()


@pytest.mark.parametrize(
    "said",
    [
        struct.pack(">BQQ", 1, 10**6, 0),
        struct.pack(">BQQ", 3, 0, 0),
        b"\x00",
        struct.pack(">BHH", 2, 2, 1) + b"\xff\xfed",
    ],
)
def test_a_receiver_that_says_what_cannot_be_is_given_up(said: bytes) -> None:
    told: queue.Queue[tuple[str, str]] = queue.Queue()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def lie() -> None:
            connection, _ = server.accept()
            connection.sendall(greet(connection, KEYS, PEERS).writer.seal(said))
            with suppress(OSError):
                connection.recv(1000)
            told.join()
            connection.close()

        threading.Thread(target=lie, daemon=True).start()
        sender = LinkSender(
            TokenBucket(1e6, 1e4), keys=KEYS, capacity_bytes=1000, on_lost=lambda *what: told.put(what)
        )
        sender.connect("ground", Endpoint(*server.getsockname()[:2], KEYS.public))
        assert told.get(timeout=WAIT_S)[0] == "ground"
        assert type(sender.error).__name__ == "ProtocolError"
        sender.close()
        told.task_done()


@pytest.mark.parametrize("hello", [b"SLNK\x02", b"SLNK\x07", b"\x00\x01\x02\x03\x04", b"HTTP/"])
def test_another_version_of_the_wire_form_is_refused_by_both_ends_in_words(hello: bytes) -> None:
    expected = r"(speaks version \d of the wire form|is no Searchlight of this release).*expected version "
    expected += str(WIRE_VERSION)
    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=lambda: server.accept()[0].sendall(hello + bytes(32)), daemon=True).start()
        sender = LinkSender(TokenBucket(1e6, 1e4), keys=KEYS, capacity_bytes=1000)
        with pytest.raises(ProtocolError, match=expected):
            sender.connect("ground", Endpoint(*server.getsockname()[:2], KEYS.public))
        sender.close()
    told: queue.Queue[tuple[str, str]] = queue.Queue()
    receiver = Receiver(
        "127.0.0.1", lambda _: None, keys=KEYS, peers=PEERS, on_lost=lambda *what: told.put(what)
    )
    with socket.create_connection(receiver.endpoint.address) as peer:
        peer.sendall(hello + bytes(65))
        assert re.search(expected, told.get(timeout=WAIT_S)[1])
    assert receiver.rejected == {"version": 1}
    receiver.close()

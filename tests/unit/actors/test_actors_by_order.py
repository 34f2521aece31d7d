"""What goes between the actors of a run in real time is what was ordered and what was said, and nothing is left out."""

from __future__ import annotations

import math
import queue
import threading
import time
from collections import deque
from types import SimpleNamespace

import pytest

from actors.calls import UnreachableError
from actors.live import LiveWiring, _Peer
from actors.live_record import LiveRecord
from actors.machine import MachineActor, MachineParams
from actors.metrics import Snapshot
from actors.reducer import ReducerActor
from actors.scheduler import Heard
from actors.source import SourceActor
from pipeline.allocation.plan import Assignment, Plan, assignment_to_json
from pipeline.errors import RunFailedError
from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.receiver import Receiver
from pipeline.link.sender import LinkState
from pipeline.link.sockets import shut_down
from pipeline.messages import Dropped
from pipeline.mission.controller.events import Elapsed, Gone, ReducerReport
from pipeline.mission.controller.orders import Close, Expect, Run, Say, Send
from pipeline.mission.controller.recorded import Recorded
from pipeline.mission.controller.substreams import Opened, PlanEpoch, Substream
from pipeline.mission.durable_reducer import Acknowledgement
from pipeline.mission.stages.radio_link import RadioLink
from pipeline.mission.stages.source import SourceParams

KEYS = KeyPair()
HERE = "127.0.0.1"
ENDPOINT = Endpoint(HERE, 4711, KEYS.public)


def opened(machine: str = "m", epoch: int = 3) -> Opened:
    return Opened(epoch, Assignment("v", f"{machine}:d", "d", machine, "s", 2, 1, 1e6))


class Reducer:
    """A place for results."""

    def __init__(self) -> None:
        self.got: queue.Queue = queue.Queue()
        self.receiver = Receiver(HERE, self.got.put, keys=KeyPair())

    @property
    def endpoint(self):
        return self.receiver.endpoint

    def next(self):
        return self.got.get(timeout=10.0)

    def reset(self) -> None:
        """Break the connections that there are."""
        for peer in list(self.receiver._peers.values()):
            shut_down(peer.socket)


@pytest.fixture
def reducers():
    both = Reducer(), Reducer()
    yield both
    for reducer in both:
        reducer.receiver.close()


def result(sequence: int) -> Dropped:
    return Dropped("v", "m:d", sequence, sequence, "undecodable", 3, sequence)


def _machine(reducer: Reducer, resend_s: float = 0.2) -> MachineActor:
    machine = MachineActor("m", HERE, "h264", MachineParams(resend_s=resend_s))
    reducer.receiver.accept_only({machine.public_key(): "machine:m"})
    machine.begin({}, reducer.endpoint, incarnation=4)
    return machine


def test_a_machine_reports_as_the_process_it_is(reducers) -> None:
    report, status = _machine(reducers[0]).report()
    assert (report.machine, report.incarnation) == ("m", 4)
    assert status.pid > 0


def test_results_are_sent_again_until_they_are_acknowledged_and_then_no_more(reducers) -> None:
    machine = _machine(reducers[0])
    for sequence in range(2):
        machine._keep_and_answer(result(sequence), False)
    assert [reducers[0].next().sequence for _ in range(2)] == [0, 1]
    machine.report()
    time.sleep(0.3)
    machine.report()
    assert [reducers[0].next().sequence for _ in range(2)] == [0, 1], "nobody has said that they are safe"
    for _ in range(3):
        machine.report((Acknowledgement("v", "m:d", 3, 2),))
        time.sleep(0.25)
    assert reducers[0].got.empty()


def test_the_next_reducer_is_sent_what_is_not_safe_and_only_that(reducers) -> None:
    machine = _machine(reducers[0], resend_s=60.0)
    for sequence in range(3):
        machine._keep_and_answer(result(sequence), False)
    machine.report((Acknowledgement("v", "m:d", 3, 1),))
    reducers[1].receiver.accept_only({machine.public_key(): "machine:m"})
    machine.results_to(reducers[1].endpoint)
    assert [reducers[1].next().sequence for _ in range(2)] == [1, 2]
    machine._keep_and_answer(result(3), False)
    assert reducers[1].next().sequence == 3


def test_a_machine_whose_reducer_is_gone_keeps_its_results_for_the_next(reducers) -> None:
    machine = _machine(reducers[0], resend_s=60.0)
    reducers[0].receiver.close()
    time.sleep(0.2)
    for sequence in range(3):
        machine._keep_and_answer(result(sequence), False)
    reducers[1].receiver.accept_only({machine.public_key(): "machine:m"})
    machine.results_to(reducers[1].endpoint)
    assert [reducers[1].next().sequence for _ in range(3)] == [0, 1, 2]


def test_a_machine_whose_connection_to_the_reducer_breaks_makes_it_again_and_sends_what_is_not_safe(
    reducers,
) -> None:
    machine = _machine(reducers[0], resend_s=60.0)
    machine._keep_and_answer(result(0), False)
    assert reducers[0].next().sequence == 0
    reducers[0].reset()
    assert reducers[0].next().sequence == 0, "nobody has said that it is safe"
    machine._keep_and_answer(result(1), False)
    assert reducers[0].next().sequence == 1


def test_a_machine_that_begins_before_its_reducer_hears_it_sends_to_it_once_it_does(reducers) -> None:
    machine = MachineActor("m", HERE, "h264", MachineParams(resend_s=60.0))
    machine.begin({}, reducers[0].endpoint)
    machine._keep_and_answer(result(0), False)
    reducers[0].receiver.accept_only({machine.public_key(): "machine:m"})
    assert reducers[0].next().sequence == 0


def test_a_machine_begins_without_a_reducer_and_is_told_of_it_later(reducers) -> None:
    machine = MachineActor("m", HERE, "h264", MachineParams(resend_s=60.0))
    machine.begin({}, None)
    machine._keep_and_answer(result(0), False)
    reducers[0].receiver.accept_only({machine.public_key(): "machine:m"})
    machine.results_to(reducers[0].endpoint)
    assert reducers[0].next().sequence == 0


def test_a_machine_fetches_every_model_and_looks_at_a_picture_before_it_has_to_take_over(
    reducers, monkeypatch
) -> None:
    done: queue.Queue = queue.Queue()

    def load(detector, layers):
        done.put(("load", detector, layers))
        return SimpleNamespace(detect=lambda picture: done.put(("look", picture.shape)))

    fetched = SimpleNamespace(on_this_node=lambda d: done.put(("fetch", d.id)) or SimpleNamespace(id=d.id))
    monkeypatch.setattr("actors.machine.open_pool_detector", load)
    pool = {
        name: SimpleNamespace(id=name, memory=memory) for name, memory in (("large", 9e6), ("small", 1e6))
    }
    machine = MachineActor("m", HERE, "h264", MachineParams(warm_s=0.01))
    machine.begin(pool, reducers[0].endpoint, {"person": 0}, models=fetched)
    said = [done.get(timeout=10.0) for _ in range(4)]
    assert said[:2] == [("fetch", "small"), ("fetch", "large")]
    assert (said[2][0], said[2][1].id, said[2][2], said[3][0]) == ("load", "small", {"person": 0}, "look")


def test_a_model_that_cannot_be_fetched_yet_is_no_end(reducers) -> None:
    def fetch(detector):
        raise RunFailedError("no way")

    machine = MachineActor("m", HERE, "h264", MachineParams(warm_s=0.01))
    pool = {"small": SimpleNamespace(id="small", memory=1e6)}
    machine.begin(pool, reducers[0].endpoint, models=SimpleNamespace(on_this_node=fetch))
    time.sleep(0.2)
    assert machine.report()[1].error is None


def test_what_a_machine_is_not_to_hold_any_more_is_not_sent_again(reducers) -> None:
    machine = _machine(reducers[0], resend_s=60.0)
    machine._stage.run = lambda order: (opened().key,)  # it held this, and drops it
    machine._keep_and_answer(result(0), False)
    machine.run(Run("m", ()))
    reducers[1].receiver.accept_only({machine.public_key(): "machine:m"})
    machine.results_to(reducers[1].endpoint)
    time.sleep(0.3)
    assert reducers[1].got.empty()


def _state(rate_bps: float, full: bool) -> LinkState:
    return LinkState(rate_bps, full, 0.0, 0, 0, {})


def test_a_source_reports_what_its_limited_links_let_through_and_more_of_those_that_are_not_full() -> None:
    bandwidth = {"full": 6e6, "easy": 6e6, "own": math.inf}
    source = SourceActor(
        SimpleNamespace(stream="v", video=SimpleNamespace(pictures=9), source=None, trajectory=None),
        (),
        bandwidth,
        SourceParams(),
    )
    states = {"full": _state(1e6, True), "easy": _state(2e6, False), "own": _state(math.inf, False)}
    source._link = SimpleNamespace(states=lambda: states)
    report, _ = source.report(incarnation=2)
    assert (report.stream, report.incarnation, report.epoch) == ("v", 2, -1)
    assert {m.site: m.rate_bps for m in report.links} == {"full": 1e6, "easy": 3e6}


def test_a_source_keeps_the_newest_epoch_it_was_ordered_to_follow() -> None:
    source = SourceActor(SimpleNamespace(stream="v"), (), {}, SourceParams())
    newer, older = Send(PlanEpoch("v", 5)), Send(PlanEpoch("v", 4))
    source.follow(newer, {"m": ENDPOINT})
    source.follow(older, {})
    assert source._order == (newer, {"m": ENDPOINT})


def test_a_way_to_nobody_is_down_until_there_is_somebody(reducers) -> None:
    lost: list[tuple[str, str, str]] = []
    link = RadioLink("v", {"s": 6e6}, KEYS, on_lost=lambda *what: lost.append(what))
    link.expect("s", "m:d", None)
    assert not link.is_up("s", "m:d")
    gone = reducers[1].endpoint
    reducers[1].receiver.close()
    link.expect("s", "m:d", gone)
    assert not link.is_up("s", "m:d")
    assert lost[0][:2] == ("s", f"s at {HERE}:{gone.port}")
    assert link.take_restarts() == {"m:d"}
    reducers[0].receiver.accept_only({KEYS.public: "source:v"})
    link.expect("s", "m:d", reducers[0].endpoint)
    assert link.is_up("s", "m:d")
    link.close()


def test_a_way_to_somebody_who_does_not_hear_yet_is_up_once_they_do(reducers) -> None:
    back: queue.Queue[str] = queue.Queue()
    link = RadioLink("v", {"s": 6e6}, KEYS, on_back=lambda site, name: back.put(site))
    link.expect("s", "m:d", reducers[0].endpoint)
    assert not link.is_up("s", "m:d")
    reducers[0].receiver.accept_only({KEYS.public: "source:v"})
    assert back.get(timeout=10.0) == "s"
    assert link.is_up("s", "m:d")
    assert link.take_restarts() == {"m:d"}, "a decoder that was not there has missed what came before"
    link.close()


class Called:
    """A handle that notes how its methods are called."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, tuple]] = []

    def __getattr__(self, name: str):
        return SimpleNamespace(remote=lambda *arguments: self.calls.append((name, arguments)))


def _wiring() -> tuple[LiveWiring, Called, Called, Called]:
    wiring = LiveWiring.__new__(LiveWiring)
    machine, source, reducer = Called(), Called(), Called()
    acknowledged = (Acknowledgement("v", "m:d", 3, 7),)
    wiring._peers = {
        "machine:m": _Peer(machine, 1, reached=ENDPOINT),
        "source:v": _Peer(source, 2),
        "reducer": _Peer(reducer, 5, status=SimpleNamespace(acknowledged=acknowledged)),
    }
    wiring._machines, wiring._sources, wiring._reducer = {"m": machine}, {"v": source}, reducer
    return wiring, machine, source, reducer


def test_every_order_reaches_its_actor_and_a_source_is_told_where_the_machines_listen() -> None:
    wiring, machine, source, reducer = _wiring()
    run, send = Run("m", (opened(),), 1, 2), Send(PlanEpoch("v", 4, (opened(),)), False, 2)
    expect = Expect((opened(),))
    for order in (run, send, expect):
        wiring._carry_out(order)
    assert machine.calls == [("run", (run,))]
    assert source.calls == [("follow", (send, {"m": ENDPOINT}))]
    assert reducer.calls == [("expect", (expect,))]


def test_who_is_out_of_reach_is_asked_again_and_only_who_has_died_is_gone(monkeypatch) -> None:
    wiring, *_ = _wiring()
    raised = [UnreachableError("out of reach"), RunFailedError("died")]

    def get(ref, actor):
        raise raised.pop(0)

    monkeypatch.setattr("actors.live.get", get)
    peer = wiring._peers["source:v"]
    peer.asked = "question"
    assert wiring._heard("source:v", "question") == []
    assert peer.asked is None
    assert math.isfinite(peer.due_s)
    assert wiring._heard("source:v", "question") == [Gone("source:v", 2, "died")]
    assert math.isinf(peer.due_s)


def test_everybody_is_told_whom_to_hear_and_neither_who_was_replaced_nor_who_was_revoked_is() -> None:
    wiring, machine, _, reducer = _wiring()
    wiring._revoked = set()
    wiring._peers["machine:m"].key, wiring._peers["source:v"].key = b"m", b"v"
    wiring._peers["source:w"] = _Peer(Called(), 0, key=b"w")
    wiring._tell_keys()
    wiring._peers["source:w"] = _Peer(Called(), 1)  # its key is not known yet
    wiring._tell_keys()
    wiring._revoked = {"v"}
    wiring._tell_keys()
    heard = [({b"v": "source:v", b"w": "source:w"},), ({b"v": "source:v"},), ({},)]
    assert machine.calls == [("accept_only", said) for said in heard]
    assert reducer.calls == [("accept_only", ({b"m": "machine:m"},))] * 3


def test_what_was_taken_is_kept_for_the_next_scheduler_written_and_known_to_have_run() -> None:
    written = []
    record = LiveRecord(10.0, "first", SimpleNamespace(append=written.append), None, None)
    taken = Recorded(11.0, Elapsed(), (Run("m", (opened(),), 1, 2), Say("up", "machine:m")))
    record.take(Heard((taken,), all_planned=False))
    record.note(Say("up", "machine:m"), 12.5)
    assert (record.state, record.log, written) == ("first", [taken], [(taken,)])
    record.take(Heard((taken,), all_planned=False, state="later"))
    assert (record.state, record.log) == ("later", [])
    assert record.ran == {("v", "m:d"): opened().assignment}
    assert [(e.at_s, e.what, e.subject) for e in record.timeline] == [(2.5, "up", "machine:m")]


def test_machines_are_asked_with_what_is_safe_and_the_others_with_their_incarnation() -> None:
    wiring, machine, source, reducer = _wiring()
    for actor, peer in wiring._peers.items():
        wiring._question(actor, peer)
    assert machine.calls == [("report", ((Acknowledgement("v", "m:d", 3, 7),),))]
    assert source.calls == [("report", (2,))]
    assert reducer.calls == [("report", (5,))]


def test_machines_are_told_where_a_new_reducer_listens() -> None:
    wiring, machine, _, _ = _wiring()
    wiring._tell_machines_the_reducer((HERE, 99))
    assert machine.calls == [("results_to", ((HERE, 99),))]


def _reducer_actor(open_: set, over: set) -> tuple[ReducerActor, list]:
    actor, calls = ReducerActor.__new__(ReducerActor), []
    actor._changed = threading.Condition()
    actor._machine_of = {}
    actor._stage = SimpleNamespace(open=frozenset(open_), sequencer=SimpleNamespace(over=frozenset(over)))
    actor._durable = SimpleNamespace(
        open_again=lambda *what: calls.append(("open", *what)),
        close=lambda *what: calls.append(("close", *what)),
        commit=lambda: calls.append(("commit",)),
    )
    return actor, calls


def test_the_reducer_opens_what_is_expected_with_its_assignment_closes_the_rest_and_commits_both() -> None:
    old, kept, ended = ("v", "m:d", 0), ("v", "m:d", 1), ("v", "m:d", 2)
    actor, calls = _reducer_actor({old, kept}, {ended})
    expect = Expect(
        (opened(epoch=1), opened(epoch=2), opened(epoch=3)),
        (Close(Substream("v", "m:d", 0), "machine_lost"), Close(Substream("v", "x:d", 9), "not_used")),
    )
    actor._carry_out(expect)
    assert calls == [
        ("open", "v", "m:d", 3, assignment_to_json(opened().assignment)),
        ("close", "v", "m:d", 0, "machine_lost"),
        ("close", "v", "x:d", 9, "not_used"),
        ("commit",),
    ]


def test_a_reducer_whose_map_is_busy_still_answers_and_takes_orders_until_it_is_busy_for_too_long() -> None:
    actor, calls = _reducer_actor({("v", "m:d", 0)}, set())
    actor._orders, actor._said, actor._said_s = deque(), None, float("-inf")
    actor.status = lambda: "as it is"
    first = actor.report(3)
    assert first == (ReducerReport(3, frozenset({Substream("v", "m:d", 0)})), "as it is")
    let_go, busy = threading.Event(), threading.Event()

    def hold() -> None:
        with actor._changed:
            busy.set()
            let_go.wait(30.0)

    holder = threading.Thread(target=hold)
    holder.start()
    busy.wait(30.0)
    actor.status = lambda: "as it will be"
    assert actor.report(3) == first
    actor.expect(Expect(()))
    assert calls == []
    actor._said_s -= 60.0  # as if it had been busy for a minute: now it is silent, as one that hangs must be
    later: list[object] = []
    waiting = threading.Thread(target=lambda: later.append(actor.report(3)))
    waiting.start()
    waiting.join(0.5)
    assert later == []
    let_go.set()
    waiting.join(30.0)
    holder.join(30.0)
    assert later == [(first[0], "as it will be")]


def test_what_the_reducer_holds_open_unasked_is_closed_as_not_used() -> None:
    actor, calls = _reducer_actor({("v", "m:d", 0)}, set())
    actor._carry_out(Expect(()))
    assert calls == [("close", "v", "m:d", 0, "not_used"), ("commit",)]


def test_how_often_actors_were_lost_reaches_the_metrics() -> None:
    wiring, *_ = _wiring()
    wiring._record = LiveRecord(0.0, "first", SimpleNamespace(append=len), None, None)
    wiring._sources, wiring._machines = {}, {}
    for what, actor in (("lost", "reducer"), ("up", "reducer"), ("lost", "reducer"), ("lost", "machine:m")):
        wiring._record.note(Say(what, actor), 1.0)
    plan = Plan("optimal", 1.0, 1.0, 0.0, 1, (), 0.1, 1, 1)
    assert wiring._newest(Snapshot(plan)).losses == {"reducer": 2, "machine:m": 1}

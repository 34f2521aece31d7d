"""Single steps of the controller: what follows from one event."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from pipeline.allocation.plan import Assignment
from pipeline.allocation.problem import Detector, MachineLimit, Problem
from pipeline.mission.controller.controller import step
from pipeline.mission.controller.events import (
    Elapsed,
    FailedSubstream,
    Gone,
    LinkMeasure,
    MachineReport,
    MissionStopped,
    NotSolved,
    ProblemChanged,
    ReducerReport,
    Solved,
    SourceReport,
    StreamPaused,
    StreamStopped,
    Unserved,
)
from pipeline.mission.controller.links import declared, measured
from pipeline.mission.controller.orders import Expect, Finish, Restart, Run, Say, Send, Solve
from pipeline.mission.controller.params import ControllerParams
from pipeline.mission.controller.state import MissionState, begin
from pipeline.mission.controller.substreams import Opened, Substream

PARAMS = ControllerParams()


def problem(streams: tuple[str, ...] = ("v",), machines: str = "ab", memory: float = 2e6) -> Problem:
    limits = tuple(MachineLimit(m, "ground", memory) for m in machines)
    detectors = tuple(
        Detector(f"{m}:{name}", name, m, "ground", period, 1e6, (0.5, 0.7), 0.1)
        for m in machines
        for name, period in (("fast", 1), ("slow", 2))
    )
    links = {(v, "ground"): 6e6 for v in streams}
    return Problem(streams, ("ground",), limits, detectors, (1e6, 2e6), links, 10.0, 3, 2, 0.9)


def assignment(
    stream: str = "v", machine: str = "a", phase: int = 0, name: str = "fast", mbps: float = 1.0
) -> Assignment:
    period = {"fast": 1, "slow": 2}[name]
    return Assignment(stream, f"{machine}:{name}", name, machine, "ground", period, phase, mbps * 1e6)


class Mission:
    """A controller with obedient actors: they do at once what they are told."""

    def __init__(self, problem: Problem, plan: tuple[Assignment, ...] = (), start: bool = True) -> None:
        self.now, self.orders = 0.0, []
        self.state: MissionState = begin(problem, 0.0)
        self.plan = plan
        self.open: set[Substream] = set()
        self.closed: set[Substream] = set()
        if start:
            for m in problem.machines:
                self.tell(MachineReport(m.id, 0))
            for v in problem.streams:
                self.tell(SourceReport(v, 0, -1))
            self.tell(ReducerReport(0))
            self.answer(plan)

    def tell(self, event, after: float = 0.01):
        self.now += after
        self.state, orders = step(self.state, event, self.now)
        self.orders += orders
        return orders

    def answer(self, plan: tuple[Assignment, ...], unserved: tuple[Unserved, ...] = ()) -> None:
        """Answer every question with a plan, until none is asked."""
        while self.state.asked is not None:
            self.obey(self.tell(Solved(self.state.asked.request, plan, unserved)))

    def ask(self) -> None:
        """Let the controller ask for a plan again."""
        self.state = replace(self.state, situation=None)
        self.tell(Elapsed())

    def obey(self, orders):
        """Machines and reducer do what they are told; then the sources."""
        more = []
        for o in orders:
            if isinstance(o, Run):
                keys = frozenset(x.key for x in o.substreams)
                more += self.tell(MachineReport(o.machine, o.incarnation, keys, keys))
            if isinstance(o, Expect):
                self.closed |= {c.substream for c in o.close}
                self.open = (self.open | o.keys) - self.closed
                incarnation = self.state.reducer.peer.incarnation
                more += self.tell(ReducerReport(incarnation, frozenset(self.open), frozenset(self.closed)))
        for o in [*orders, *more]:
            if isinstance(o, Send):
                self.tell(SourceReport(o.epoch.stream, o.incarnation, o.epoch.number, ended=o.over))
        return more

    def followed(self, stream: str = "v") -> tuple[Opened, ...]:
        standing = self.state.streams[stream].standing
        return standing.substreams if standing else ()


def kinds(orders) -> list[str]:
    return [type(o).__name__ for o in orders]


def test_the_first_plan_becomes_the_first_epoch_once_machine_and_reducer_are_ready() -> None:
    mission = Mission(problem(), (assignment(),))
    assert [o.assignment for o in mission.followed()] == [assignment()]


def test_a_source_is_not_switched_before_the_new_detector_is_warm() -> None:
    mission = Mission(problem(), (assignment(),))
    before = mission.followed()
    mission.tell(Gone("machine:b", 0, "killed"))
    orders = mission.tell(Solved(mission.state.requests, (assignment(mbps=2.0),)))
    assert "Run" in kinds(orders)
    assert "Send" not in kinds(orders)
    assert mission.followed() == before
    mission.obey(orders)
    assert [o.assignment.bitrate_bps for o in mission.followed()] == [2e6]


def test_a_substream_that_only_shifts_its_phase_goes_on() -> None:
    slow = (assignment(name="slow"), assignment(machine="b", phase=1, name="slow"))
    mission = Mission(problem(), slow)
    before = {o.key for o in mission.followed()}
    mission.ask()
    mission.answer((assignment(name="slow", phase=1), assignment(machine="b", phase=0, name="slow")))
    assert {o.key for o in mission.followed()} == before
    assert [o.assignment.phase for o in mission.followed()] == [1, 0]


@pytest.mark.parametrize("change", [{"mbps": 2.0}, {"name": "slow"}, {"machine": "b"}])
def test_any_other_change_opens_another_substream(change: dict) -> None:
    mission = Mission(problem(), (assignment(),))
    (before,) = mission.followed()
    mission.ask()
    mission.answer((assignment(**change),))
    (after,) = mission.followed()
    assert after.key != before.key
    assert after.epoch > before.epoch


def test_of_a_lost_machine_nothing_more_is_taken_and_its_streams_are_planned_again() -> None:
    mission = Mission(problem(), (assignment(),))
    (opened,) = mission.followed()
    orders = mission.tell(Gone("machine:a", 0, "killed"))
    (solve,) = [o for o in orders if isinstance(o, Solve)]
    assert [m.id for m in solve.problem.machines] == ["b"]
    assert {d.machine for d in solve.problem.detectors} == {"b"}
    (expect,) = [o for o in orders if isinstance(o, Expect)]
    assert [(c.substream, c.reason) for c in expect.close] == [(opened.key, "machine_lost")]
    assert mission.followed() == ()


def test_an_actor_is_lost_after_its_silence_and_up_again_when_it_is_heard() -> None:
    mission = Mission(problem(), (assignment(),))
    start, lost = mission.now, []
    while mission.now < start + 1.9:
        orders = mission.tell(ReducerReport(0, frozenset(mission.open)), 0.1)
        orders += mission.tell(SourceReport("v", 0, 1), 0.0) + mission.tell(MachineReport("b", 0), 0.0)
        lost += [(mission.now, o.subject) for o in orders if isinstance(o, Say) and o.what == "lost"]
    assert [name for _, name in lost] == ["machine:a"]
    assert PARAMS.silence_s <= lost[0][0] - start <= 2.0
    mission.tell(MachineReport("a", 0))
    assert mission.state.machines["a"].peer.is_up


def test_a_silent_machine_is_replaced_later_than_a_dead_one() -> None:
    def restart_after_s(event_of) -> float:
        mission = Mission(problem(), (assignment(),))
        lost_s = None
        while mission.now < 20.0:
            orders = mission.tell(ReducerReport(0, frozenset(mission.open)), 0.1)
            orders += mission.tell(MachineReport("b", 0), 0.0) + mission.tell(SourceReport("v", 0, 1), 0.0)
            orders += mission.tell(event_of(mission), 0.0)
            if lost_s is None and mission.state.machines["a"].peer.life == "lost":
                lost_s = mission.now
            if any(isinstance(o, Restart) and o.actor == "machine:a" for o in orders):
                return mission.now - lost_s
        return math.inf

    dead = restart_after_s(lambda mission: Gone("machine:a", 0, "killed"))
    silent = restart_after_s(lambda mission: Elapsed())
    assert dead < 0.5
    assert PARAMS.replace_s <= silent < PARAMS.replace_s + 0.5


@pytest.mark.parametrize(
    "stale",
    [
        Gone("machine:a", 0, "killed"),
        MachineReport("a", 0, ready=frozenset({Substream("v", "a:fast", 0)})),
        Gone("reducer", 0, "killed"),
        ReducerReport(0, finished=True),
        Gone("source:v", 0, "killed"),
        SourceReport("v", 0, 99, ended=True),
    ],
    ids=str,
)
def test_what_is_said_of_a_process_that_was_replaced_changes_nothing(stale) -> None:
    mission = Mission(problem(), (assignment(),))
    for actor in ("machine:a", "reducer", "source:v"):
        mission.tell(Gone(actor, 0, "killed"))
    mission.tell(Elapsed(), 0.6)
    assert mission.state.machines["a"].peer.incarnation == 1
    as_if_nothing = step(mission.state, Elapsed(), mission.now)
    assert step(mission.state, stale, mission.now) == as_if_nothing


def test_an_answer_to_an_older_question_is_not_taken() -> None:
    mission = Mission(problem(), (assignment(),))
    mission.tell(Gone("machine:b", 0, "killed"))
    old = mission.state.requests - 1
    mission.tell(Solved(old, (assignment(mbps=2.0),)))
    assert mission.state.asked is not None
    assert mission.state.streams["v"].wanted[0].assignment.bitrate_bps == 1e6


def test_a_better_plan_may_follow_the_first_one_to_the_same_question() -> None:
    mission = Mission(problem(), ())
    mission.ask()
    request = mission.state.requests
    mission.obey(mission.tell(Solved(request, (assignment(),), final=False)))
    assert [o.assignment.bitrate_bps for o in mission.followed()] == [1e6]
    mission.obey(mission.tell(Solved(request, (assignment(mbps=2.0),))))
    assert [o.assignment.bitrate_bps for o in mission.followed()] == [2e6]


def test_a_question_that_found_nothing_is_asked_again_and_what_runs_goes_on() -> None:
    mission = Mission(problem(), (assignment(),))
    before = mission.followed()
    mission.tell(Gone("machine:b", 0, "killed"))
    mission.tell(NotSolved(mission.state.requests, "the solver died"))
    asked, report = [], mission.state.machines["a"].report
    for _ in range(20):
        orders = mission.tell(report, 0.1) + mission.tell(ReducerReport(0, frozenset(mission.open)), 0.0)
        orders += mission.tell(SourceReport("v", 0, 1), 0.0)
        asked += [o for o in orders if isinstance(o, Solve)]
    assert asked
    assert mission.followed() == before


def test_a_detector_that_breaks_too_often_is_planned_with_no_more() -> None:
    mission = Mission(problem(), (assignment(),))
    for _ in range(PARAMS.failures):
        (opened,) = mission.state.streams["v"].wanted
        orders = mission.tell(MachineReport("a", 0, failed=(FailedSubstream(opened.key, "out of memory"),)))
        (solve,) = [o for o in orders if isinstance(o, Solve)]
        mission.answer((assignment(),))
    assert "a:fast" not in {d.id for d in solve.problem.detectors}
    assert "a:slow" in {d.id for d in solve.problem.detectors}


def test_a_link_that_lets_through_less_is_planned_with_less_at_once_and_with_more_later() -> None:
    link, now, trace = declared(6e6), 0.0, {}
    for _ in range(200):
        now += 0.1
        link = measured(link, 1e6 if now < 8.0 else 6e6, now, PARAMS)
        trace[round(now, 1)] = link.planned_bps
    assert trace[0.6] == pytest.approx(0.9e6), "worse: within half a second"
    assert trace[15.0] == pytest.approx(0.9e6), "better: not for some seconds"
    assert trace[17.0] == pytest.approx(0.9 * 6e6)


def test_a_link_is_never_planned_with_more_than_was_declared() -> None:
    link = declared(6e6)
    for k in range(200):
        link = measured(link, math.inf, 0.1 * k, PARAMS)
    assert link.planned_bps == 6e6


def test_a_measured_link_leads_to_a_question_with_what_it_lets_through() -> None:
    mission = Mission(problem(), (assignment(),))
    orders = []
    for _ in range(8):
        orders += mission.tell(SourceReport("v", 0, 1, links=(LinkMeasure("ground", 1e6),)), 0.1)
    solve = [o for o in orders if isinstance(o, Solve)][-1]
    assert solve.problem.link_bps["v", "ground"] == pytest.approx(0.9e6)


def test_an_unserved_stream_is_said_with_its_reason_and_again_when_it_is_served() -> None:
    mission = Mission(problem(("v", "w")), (assignment(),))
    mission.ask()
    mission.answer((assignment(),), (Unserved("w", "no link carries it"),))
    assert Say("unserved", "w", "no link carries it") in mission.orders
    mission.ask()
    mission.answer((assignment(), assignment("w", "b")))
    assert Say("served again", "w") in mission.orders


def test_a_paused_stream_is_looked_at_by_nobody_and_goes_on_when_it_is_wanted() -> None:
    mission = Mission(problem(), (assignment(),))
    orders = mission.tell(StreamPaused("v", True))
    assert [o.epoch.substreams for o in orders if isinstance(o, Send)] == [()]
    orders = mission.tell(StreamPaused("v", False))
    assert "Solve" in kinds(orders)
    mission.answer((assignment(),))
    assert [o.assignment for o in mission.followed()] == [assignment()]


def test_a_stream_that_the_operator_ends_does_not_wait_for_a_source_that_is_lost() -> None:
    mission = Mission(problem(("v", "w")), (assignment("v"), assignment("w", "b")))
    mission.tell(Gone("source:v", 0, "its node is gone"))
    mission.obey(mission.tell(StreamStopped("v")))
    assert mission.state.streams["v"].ended
    restarts = [o for o in mission.orders if isinstance(o, Restart)]
    mission.tell(Elapsed(), after=40.0)
    assert [o for o in mission.orders if isinstance(o, Restart) and o.actor == "source:v"] == restarts
    assert Say("ended", "v", "its source is not heard") in mission.orders
    assert not mission.state.streams["w"].ended


@pytest.mark.parametrize("event", [StreamStopped("v"), MissionStopped()])
def test_a_stopped_stream_ends_and_then_the_mission_finishes(event) -> None:
    mission = Mission(problem(), (assignment(),))
    orders = mission.tell(event)
    assert [o.over for o in orders if isinstance(o, Send)] == [True]
    mission.obey(orders)
    assert mission.state.streams["v"].ended
    finish = mission.tell(ReducerReport(0, closed=frozenset(mission.open)))
    assert Finish() in finish
    mission.tell(ReducerReport(0, finished=True))
    assert mission.state.finished


def test_a_changed_inventory_starts_what_is_new_and_closes_what_is_gone() -> None:
    mission = Mission(problem(), (assignment(),))
    (opened,) = mission.followed()
    orders = mission.tell(ProblemChanged(problem(("v", "w"), machines="bc")))
    assert "w" in mission.state.streams
    assert "c" in mission.state.machines
    (expect,) = [o for o in orders if isinstance(o, Expect)]
    assert [c.reason for c in expect.close if c.substream == opened.key] == ["machine_removed"]
    (solve,) = [o for o in orders if isinstance(o, Solve)]
    assert solve.problem.streams == ("v", "w")


def test_an_order_is_given_again_until_it_is_followed_and_then_no_more() -> None:
    mission = Mission(problem(), ())
    mission.ask()
    orders = mission.tell(Solved(mission.state.requests, (assignment(),)))
    (run,) = [o for o in orders if isinstance(o, Run)]
    again = []
    for _ in range(12):
        again += mission.tell(MachineReport("a", 0), 0.1)
    assert [o for o in again if isinstance(o, Run)] == [run, run]
    keys = frozenset(o.key for o in run.substreams)
    quiet = []
    for _ in range(12):
        quiet += mission.tell(MachineReport("a", 0, keys, keys), 0.1)
    assert not [o for o in quiet if isinstance(o, Run)]


def test_nothing_is_sent_to_the_dead_though_what_is_wanted_instead_is_not_ready_yet() -> None:
    mission = Mission(problem(), (assignment(),))
    mission.ask()
    mission.tell(Solved(mission.state.requests, (assignment(machine="b"),)))
    assert [o.assignment.machine for o in mission.followed()] == ["a"], "b is still loading"
    mission.tell(Gone("machine:a", 0, "killed"))
    assert mission.followed() == ()


def test_a_detector_that_breaks_while_a_better_plan_is_awaited_is_planned_for_at_once() -> None:
    mission = Mission(problem(), ())
    mission.ask()
    request = mission.state.requests
    mission.obey(mission.tell(Solved(request, (assignment(),), final=False)))
    (opened,) = mission.followed()
    orders = mission.tell(MachineReport("a", 0, failed=(FailedSubstream(opened.key, "crashed"),)))
    assert [o.request for o in orders if isinstance(o, Solve)] == [request + 1]
    # the better plan is of before, and would have brought the broken one back
    mission.tell(Solved(request, (assignment(mbps=2.0),)))
    assert mission.state.streams["v"].wanted == ()

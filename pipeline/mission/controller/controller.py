"""``step``: one event in, the next state and the orders out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from pipeline.mission.controller.adoption import adopt
from pipeline.mission.controller.away import notice_cut_off
from pipeline.mission.controller.events import (
    Elapsed,
    Event,
    Gone,
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
from pipeline.mission.controller.holding import Holding, holdings
from pipeline.mission.controller.links import declared
from pipeline.mission.controller.losses import end_what_is_over, notice_silence, restart_what_is_due, without
from pipeline.mission.controller.orders import Close, Expect, Finish, Order, Run, Say, Send, Solve
from pipeline.mission.controller.peers import excused, starting
from pipeline.mission.controller.reports import gone, machine_reports, reducer_reports, source_reports
from pipeline.mission.controller.situation import Situation, problem_now, situation_of
from pipeline.mission.controller.state import (
    REDUCER,
    Asked,
    Given,
    MachineState,
    MissionState,
    StreamState,
    machine_actor,
    source_actor,
    with_stream,
)
from pipeline.mission.controller.switching import switch

Step = tuple[MissionState, list[Order]]


def step(state: MissionState, event: Event, now: float) -> Step:
    """The next state, and what is to be done.

    now: seconds, by any clock that never goes back. Orders are given for this moment; those that are lost come again.
    """
    state = _excuse_own_absence(state, now)
    state, orders = _take(state, event, now)
    for stage in (notice_cut_off, notice_silence, end_what_is_over, restart_what_is_due, _ask):
        state, more = stage(state, now)
        orders += more
    held = holdings(state)
    in_the_way = {key for holding in held.values() for key in holding.in_the_way}
    state, said = switch(state, in_the_way, now)
    state, told = _tell(state, held, now)
    return state, [*orders, *said, *told]


def _excuse_own_absence(state: MissionState, now: float) -> MissionState:
    """After a time in which nobody could be heard, since nobody listened, nobody is silent for that."""
    away_s = now - state.last_s
    if away_s <= state.params.absence_s:
        return replace(state, last_s=now)
    away_s -= state.params.step_s
    streams = {n: replace(s, source=excused(s.source, away_s)) for n, s in state.streams.items()}
    machines = {n: replace(m, peer=excused(m.peer, away_s)) for n, m in state.machines.items()}
    reducer = replace(state.reducer, peer=excused(state.reducer.peer, away_s))
    return replace(state, streams=streams, machines=machines, reducer=reducer, last_s=now)


def _take(state: MissionState, event: Event, now: float) -> Step:
    return _TAKEN_BY[type(event)](state, event, now)


def _answered(state: MissionState, answer: Solved, now: float) -> Step:
    """Take an answer to the question that stands; others are to questions that were given up."""
    asked = state.asked
    if asked is None or not _is_to(asked, answer):
        return state, []
    assert isinstance(asked.situation, Situation)
    after = None if answer.final else replace(asked, at_s=math.inf)
    return adopt(replace(state, asked=after, situation=asked.situation), answer, situation_of(state))


def _is_to(asked: Asked, answer: Solved | NotSolved) -> bool:
    return asked.request == answer.request


def _not_answered(state: MissionState, event: NotSolved, now: float) -> Step:
    """What runs goes on; the question is asked again after a while."""
    asked, params = state.asked, state.params
    if asked is None or not _is_to(asked, event):
        return state, []
    again = replace(asked, at_s=now - params.solve_s + params.retry_s)
    return replace(state, asked=again), [Say("not planned", "scheduler", event.reason)]


def _stopped(state: MissionState, event: StreamStopped | MissionStopped, now: float) -> Step:
    name = event.stream if isinstance(event, StreamStopped) else None
    streams = {
        n: replace(s, over=True, wanted=()) if name in (n, None) else s for n, s in state.streams.items()
    }
    return replace(state, streams=streams), [Say("stopped by the operator", name or "mission")]


def _paused(state: MissionState, event: StreamPaused, now: float) -> Step:
    stream = state.streams.get(event.stream)
    if stream is None or stream.paused == event.paused:
        return state, []
    state = with_stream(state, event.stream, replace(stream, paused=event.paused, wanted=()))
    return state, [Say("paused" if event.paused else "goes on", event.stream)]


def _changed(state: MissionState, event: ProblemChanged, now: float) -> Step:
    """Another inventory: what is new is being started; what is not in it any more is over."""
    problem = event.problem
    machines = {
        m.id: state.machines.get(m.id) or MachineState(starting(now), MachineReport(m.id, 0))
        for m in problem.machines
    }
    streams = {
        n: s if n in problem.streams else replace(s, over=True, wanted=()) for n, s in state.streams.items()
    }
    streams |= {v: StreamState(starting(now)) for v in problem.streams if v not in streams}
    links = {
        key: state.links[key]
        if key in state.links and state.links[key].declared_bps == bps
        else declared(bps)
        for key, bps in problem.link_bps.items()
    }
    removed = [key for key, k in state.known.items() if k.opened.machine not in machines]
    state = without(state, removed, "machine_removed")
    state = replace(
        state, problem=problem, machines=machines, streams=streams, links=links, asked=None, situation=None
    )
    return state, [Say("inventory changed", "mission")]


def _nothing(state: MissionState, event: Elapsed, now: float) -> Step:
    return state, []


_TAKEN_BY: dict[type, Callable[[MissionState, Any, float], Step]] = {
    MachineReport: machine_reports,
    SourceReport: source_reports,
    ReducerReport: reducer_reports,
    Gone: gone,
    Solved: _answered,
    NotSolved: _not_answered,
    StreamStopped: _stopped,
    MissionStopped: _stopped,
    StreamPaused: _paused,
    ProblemChanged: _changed,
    Elapsed: _nothing,
}


def _ask(state: MissionState, now: float) -> Step:
    """A question for the solver, if the standing plan is not for this situation and no answer is awaited."""
    asked, situation = state.asked, situation_of(state)
    if asked is not None and now - asked.at_s < state.params.solve_s and asked.at_s < math.inf:
        return state, []
    if situation == (asked.situation if asked else state.situation) and (
        asked is None or asked.at_s == math.inf
    ):
        return state, []
    if state.requests == 0 and _gathers(state, now):
        return state, []
    if not situation.machines or not situation.streams:
        nobody = tuple(Unserved(v, "no machine is up") for v in situation.streams)
        return adopt(replace(state, asked=None, situation=situation), Solved(0, (), nobody), situation)
    request = state.requests + 1
    running = tuple(o.assignment for v in situation.streams for o in state.streams[v].wanted)
    order = Solve(request, problem_now(state.problem, situation), running)
    return replace(state, requests=request, asked=Asked(request, situation, now)), [order]


def _gathers(state: MissionState, now: float) -> bool:
    """Whether the first plan is worth waiting for actors that are still starting."""
    peers = [*(m.peer for m in state.machines.values()), *(s.source for s in state.streams.values())]
    is_one_starting = any(peer.life == "starting" for peer in (*peers, state.reducer.peer))
    return is_one_starting and now - state.begun_s < state.params.gather_s


def _tell(state: MissionState, held: Mapping[str, Holding], now: float) -> Step:
    """Tell every actor what it should do, if it does not do it yet."""
    orders: list[Order] = []
    given = dict(state.given)

    def give(actor: str, order: Order, is_so: bool) -> None:
        last = given.get(actor)
        if last is not None and last.order == order and (is_so or now - last.at_s < state.params.reissue_s):
            return
        given[actor] = Given(order, now)
        orders.append(order)

    for name, machine in state.machines.items():
        if machine.peer.is_up:
            run = _run(name, held[name], machine.peer.incarnation, given.get(machine_actor(name)))
            give(machine_actor(name), run, {o.key for o in run.substreams} == machine.report.running)
    for name, stream in state.streams.items():
        epoch = stream.standing
        if stream.source.is_up and not stream.ended and epoch is not None:
            give(
                source_actor(name),
                Send(epoch, stream.over, stream.source.incarnation),
                stream.reported == epoch.number and not stream.over,
            )
    if state.reducer.peer.is_up:
        expect = _expect(state)
        report = state.reducer.report
        give(REDUCER, expect, expect.keys <= report.open and not expect.close)
        if _is_over(state) and not state.finished:
            give("finish", Finish(), False)
    return replace(state, given=given), orders


def _run(machine: str, held: Holding, incarnation: int, last: Given | None) -> Run:
    """The last order again if it says the same, or the next one."""
    before = last.order if last is not None else None
    if not isinstance(before, Run):
        return Run(machine, held.substreams, incarnation)
    if before.substreams == held.substreams:
        return before
    return Run(machine, held.substreams, incarnation, before.number + 1)


def _expect(state: MissionState) -> Expect:
    living = tuple(
        k.opened for _, k in sorted(state.known.items(), key=lambda item: item[0]) if k.dead is None
    )
    dead = sorted((key, k.dead) for key, k in state.known.items() if k.dead is not None)
    return Expect(living, tuple(Close(key, reason) for key, reason in dead))


def _is_over(state: MissionState) -> bool:
    return all(stream.ended for stream in state.streams.values()) and not state.known

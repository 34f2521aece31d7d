"""What a report changes."""

from __future__ import annotations

from dataclasses import replace

from pipeline.mission.controller.events import Gone, MachineReport, ReducerReport, SourceReport
from pipeline.mission.controller.links import measured
from pipeline.mission.controller.losses import machine_lost, reducer_lost, source_lost, without
from pipeline.mission.controller.orders import Order, Say
from pipeline.mission.controller.peers import heard, is_stale
from pipeline.mission.controller.state import (
    REDUCER,
    MissionState,
    machine_actor,
    source_actor,
    with_machine,
    with_stream,
)

Step = tuple[MissionState, list[Order]]


def machine_reports(state: MissionState, report: MachineReport, now: float) -> Step:
    """A machine says what it holds, and which detectors broke."""
    machine = state.machines.get(report.machine)
    if machine is None or is_stale(machine.peer, report.incarnation):
        return state, []
    said: list[Order] = [] if machine.peer.is_up else [Say("up", machine_actor(report.machine))]
    state = with_machine(state, replace(machine, peer=heard(machine.peer, now), report=report))
    return _with_failures(state, report, said)


def _with_failures(state: MissionState, report: MachineReport, said: list[Order]) -> Step:
    """A machine repeats its failures in every report; each is counted once."""
    new = [f for f in report.failed if f.substream in state.known and state.known[f.substream].dead is None]
    if not new:
        return state, said
    failures = dict(state.failures)
    for failed in new:
        detector = failed.substream.detector
        failures[detector] = failures.get(detector, 0) + 1
        said.append(Say("detector failed", detector, failed.reason))
    state = without(state, [failed.substream for failed in new], "detector_failed")
    # the same situation, but not the same substreams: plan once more; what is awaited answers a question of before
    return replace(state, failures=failures, asked=None, situation=None), said


def source_reports(state: MissionState, report: SourceReport, now: float) -> Step:
    """A source says which epoch it follows and what its links let through."""
    stream = state.streams.get(report.stream)
    if stream is None or is_stale(stream.source, report.incarnation) or stream.ended:
        return state, []
    said: list[Order] = [] if stream.source.is_up else [Say("up", source_actor(report.stream))]
    given = tuple(epoch for epoch in stream.given if epoch.number >= report.epoch)
    stream = replace(
        stream,
        source=heard(stream.source, now),
        given=given,
        reported=max(stream.reported, report.epoch),
        tick=max(stream.tick, report.tick),
    )
    if report.ended:
        stream = replace(stream, ended=True, wanted=(), given=())
        said.append(Say("ended", report.stream))
    state = with_stream(state, report.stream, stream)
    links = dict(state.links)
    for measure in report.links:
        key = report.stream, measure.site
        if key in links:
            links[key] = measured(links[key], measure.rate_bps, now, state.params)
    return replace(state, links=links), said


def reducer_reports(state: MissionState, report: ReducerReport, now: float) -> Step:
    """The reducer says which substreams are open and closed on its disk."""
    if is_stale(state.reducer.peer, report.incarnation):
        return state, []
    said: list[Order] = [] if state.reducer.peer.is_up else [Say("up", REDUCER)]
    reducer = replace(state.reducer, peer=heard(state.reducer.peer, now), report=report)
    known = {key: k for key, k in state.known.items() if key not in report.closed}
    return replace(state, reducer=reducer, known=known, finished=state.finished or report.finished), said


def gone(state: MissionState, event: Gone, now: float) -> Step:
    """A process has ended."""
    kind, _, name = event.actor.partition(":")
    if kind == "machine" and name in state.machines:
        before = state.machines[name].peer
        after = machine_lost(state, name, event.reason, now, ended=True)
    elif kind == "source" and name in state.streams:
        before = state.streams[name].source
        after = source_lost(state, name, event.reason, now, ended=True)
    elif event.actor == REDUCER:
        before = state.reducer.peer
        after = reducer_lost(state, event.reason, now, ended=True)
    else:
        return state, []
    if is_stale(before, event.incarnation):
        return state, []
    return after, [Say("lost", event.actor, event.reason)]

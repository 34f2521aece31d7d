"""An answer of the solver becomes what the streams want; what goes on keeps its substream."""

from __future__ import annotations

from dataclasses import replace

from pipeline.allocation.plan import Assignment
from pipeline.mission.controller.events import Solved
from pipeline.mission.controller.orders import Order, Say
from pipeline.mission.controller.situation import Situation
from pipeline.mission.controller.state import Known, MissionState, StreamState, with_stream
from pipeline.mission.controller.substreams import Opened


def adopt(state: MissionState, answer: Solved, situation: Situation) -> tuple[MissionState, list[Order]]:
    """Want what was planned. What was lost while the solver worked will not become ready; it is planned for next."""
    said: list[Order] = []
    why_not = {unserved.stream: unserved.reason for unserved in answer.unserved}
    for name in situation.streams:
        assignments = [a for a in answer.assignments if a.stream == name]
        before = state.streams[name]
        state = _want(state, name, assignments)
        reason = why_not.get(name)
        if reason != before.unserved:
            said.append(Say("unserved", name, reason) if reason else Say("served again", name))
        state = with_stream(state, name, replace(state.streams[name], unserved=reason))
    return state, said


def _want(state: MissionState, name: str, assignments: list[Assignment]) -> MissionState:
    stream = state.streams[name]
    wanted = tuple(_kept(state, stream, a) or Opened(stream.next_number, a) for a in assignments)
    if wanted == stream.wanted:
        return state
    known = dict(state.known)
    for opened in wanted:
        before = known.get(opened.key, Known(opened))
        known[opened.key] = replace(before, opened=opened)
    begun = any(opened.epoch == stream.next_number for opened in wanted)
    after = replace(stream, wanted=wanted, next_number=stream.next_number + begun)
    return with_stream(replace(state, known=known), name, after)


def _kept(state: MissionState, stream: StreamState, assignment: Assignment) -> Opened | None:
    """The living substream that goes on as this assignment."""
    standing = stream.standing
    for opened in (*stream.wanted, *(standing.substreams if standing else ())):
        known = state.known.get(opened.key)
        if known is not None and known.dead is None and opened.goes_on_as(assignment):
            return replace(opened, assignment=assignment)
    return None

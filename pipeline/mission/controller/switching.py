"""Which substreams a source should follow now: a switch is made before it breaks.

A stream goes over to what its plan wants once all of that could take a packet. Until then it stays with what it has;
if part of that is lost, with what covers more of its frames: the rest of the old, or what is ready of the new. Old and
new are never followed together, so that no frame is looked at more often than a plan allows.

Where a machine cannot hold old and new at once, the old goes first: the streams that keep it are made to break.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace

from pipeline.mission.controller.orders import Order, Say
from pipeline.mission.controller.state import Known, MissionState, StreamState, with_stream
from pipeline.mission.controller.substreams import Opened, PlanEpoch, Substream


def ready_substreams(state: MissionState) -> frozenset[Substream]:
    """Substreams whose machine could take a packet and whose results the reducer would take."""
    on_machines = {
        key for m in state.machines.values() if m.peer.is_up for key in m.report.ready if key in state.known
    }
    return frozenset(on_machines & state.reducer.report.open)


def switch(
    state: MissionState, in_the_way: Collection[Substream], now: float
) -> tuple[MissionState, list[Order]]:
    """Give every stream the epoch that it should follow; in_the_way: of others that have no memory otherwise."""
    ready, said = ready_substreams(state), list[Order]()
    for name, stream in state.streams.items():
        substreams = _to_follow(state, stream, ready, in_the_way)
        standing = stream.standing
        if stream.ended or (standing is not None and standing.substreams == substreams):
            continue
        if standing is None and not substreams and not stream.over:
            continue
        epoch = PlanEpoch(name, stream.next_number, substreams)
        after = replace(stream, given=(*stream.given, epoch), next_number=epoch.number + 1)
        state = _marked_given(with_stream(state, name, after), epoch)
        said.append(
            Say(
                "epoch",
                name,
                f"{epoch.number}: {', '.join(o.assignment.detector for o in substreams) or 'nobody'}",
            )
        )
    return _left(state, now), said


def _to_follow(
    state: MissionState, stream: StreamState, ready: Collection[Substream], in_the_way: Collection[Substream]
) -> tuple[Opened, ...]:
    if stream.over or stream.paused:
        return ()
    usable = tuple(o for o in stream.wanted if o.key in ready)
    if len(usable) == len(stream.wanted):
        return stream.wanted
    standing = stream.standing.substreams if stream.standing else ()
    alive = tuple(o for o in standing if _lives(state, o) and o.key not in in_the_way)
    return alive if _covered(alive) >= _covered(usable) else usable


def _lives(state: MissionState, opened: Opened) -> bool:
    known = state.known.get(opened.key)
    return known is not None and known.dead is None


def _covered(substreams: Iterable[Opened]) -> float:
    """Looks per frame."""
    return sum(1.0 / o.assignment.period for o in substreams)


def _marked_given(state: MissionState, epoch: PlanEpoch) -> MissionState:
    known = {key: replace(k, given=True) if key in epoch.keys else k for key, k in state.known.items()}
    return replace(state, known=known)


def _left(state: MissionState, now: float) -> MissionState:
    """Note since when a source sends a substream no more; what no source was ever given dies at once."""
    followed = {key for s in state.streams.values() for epoch in s.given for key in epoch.keys}
    wanted = {o.key for s in state.streams.values() for o in s.wanted}
    known = dict(state.known)
    for key, k in state.known.items():
        if k.dead is not None or key in followed or key in wanted:
            continue
        if not k.given:
            known[key] = replace(k, dead="not_used")
        elif now < k.left_s:
            known[key] = replace(k, left_s=now)
        elif _had_time_to_drain(state, k, now):
            known[key] = replace(k, dead="not_drained")
    return replace(state, known=known)


def _had_time_to_drain(state: MissionState, known: Known, now: float) -> bool:
    """Whether its last results should long have come: time in which there was nobody to take them does not count."""
    reducer = state.reducer.peer
    return reducer.is_up and now - max(known.left_s, reducer.since_s) > state.params.drain_s

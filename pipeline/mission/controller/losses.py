"""What the loss of an actor or of a detector does to the substreams that it had."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

from pipeline.mission.controller.orders import Order, Restart, Say
from pipeline.mission.controller.peers import Peer, is_silent, lost, restarted
from pipeline.mission.controller.state import (
    REDUCER,
    Known,
    MissionState,
    StreamState,
    machine_actor,
    source_actor,
    with_machine,
    with_stream,
)
from pipeline.mission.controller.substreams import Opened, Substream

SILENT = "silent"


def without(state: MissionState, keys: Collection[Substream], reason: str) -> MissionState:
    """Nobody will look at these substreams any more: no plan wants them, and the reducer is to close them."""
    gone = {key for key in keys if key in state.known and state.known[key].dead is None}
    if not gone:
        return state
    known = {key: replace(k, dead=reason) if key in gone else k for key, k in state.known.items()}
    streams = {
        name: replace(stream, wanted=tuple(o for o in stream.wanted if o.key not in gone))
        for name, stream in state.streams.items()
    }
    return replace(state, known=known, streams=streams)


def machine_lost(state: MissionState, machine: str, reason: str, now: float, *, ended: bool) -> MissionState:
    """The state without a machine. Its substreams are dead: what it may still say of them is not taken."""
    before = state.machines[machine]
    if before.peer.life == "lost":
        return with_machine(state, replace(before, peer=_sooner(before.peer, now, ended)))
    peer = lost(before.peer, reason, now, state.params, ended=ended)
    state = with_machine(state, replace(before, peer=peer))
    return without(
        state, [k for k, known in state.known.items() if known.opened.machine == machine], "machine_lost"
    )


def source_lost(state: MissionState, name: str, reason: str, now: float, *, ended: bool) -> MissionState:
    """The state with a source that cannot be counted on; its machines go on with what they have."""
    stream = state.streams[name]
    if stream.source.life == "lost":
        return with_stream(state, name, replace(stream, source=_sooner(stream.source, now, ended)))
    return with_stream(
        state, name, replace(stream, source=lost(stream.source, reason, now, state.params, ended=ended))
    )


def reducer_lost(state: MissionState, reason: str, now: float, *, ended: bool) -> MissionState:
    """The state with a reducer that cannot be counted on; what it had acknowledged it will know again."""
    peer = state.reducer.peer
    after = (
        _sooner(peer, now, ended)
        if peer.life == "lost"
        else lost(peer, reason, now, state.params, ended=ended)
    )
    return replace(state, reducer=replace(state.reducer, peer=after))


def notice_silence(state: MissionState, now: float) -> tuple[MissionState, list[Order]]:
    """Count as lost who should have been heard by now."""
    said: list[Order] = []
    for name, machine in state.machines.items():
        if is_silent(machine.peer, now, state.params):
            state = machine_lost(state, name, SILENT, now, ended=False)
            said.append(Say("lost", machine_actor(name), SILENT))
    for name, stream in state.streams.items():
        if not stream.ended and is_silent(stream.source, now, state.params):
            state = source_lost(state, name, SILENT, now, ended=False)
            said.append(Say("lost", source_actor(name), SILENT))
    if is_silent(state.reducer.peer, now, state.params):
        state = reducer_lost(state, SILENT, now, ended=False)
        said.append(Say("lost", REDUCER, SILENT))
    return state, said


def restart_what_is_due(state: MissionState, now: float) -> tuple[MissionState, list[Order]]:
    """Order the next process of every actor whose time has come, or give it up."""
    orders: list[Order] = []
    for name, machine in state.machines.items():
        if _is_due(machine.peer, now):
            state = with_machine(state, replace(machine, peer=_next(machine.peer, now, state)))
            orders += _restart(machine_actor(name), state.machines[name].peer)
    for name, stream in state.streams.items():
        if _is_due(stream.source, now) and not stream.ended:
            state = _next_source(state, name, now)
            orders += _restart(source_actor(name), state.streams[name].source)
    if _is_due(state.reducer.peer, now):
        # without it there is no map: it is never given up
        state = replace(state, reducer=replace(state.reducer, peer=restarted(state.reducer.peer, now)))
        orders += _restart(REDUCER, state.reducer.peer)
    given = {
        actor: g
        for actor, g in state.given.items()
        if actor not in {o.actor for o in orders if isinstance(o, Restart)}
    }
    return replace(state, given=given), orders


def end_what_is_over(state: MissionState, now: float) -> tuple[MissionState, list[Order]]:
    """A stream that its operator has ended waits for no source that nobody hears."""
    said: list[Order] = []
    for name, stream in state.streams.items():
        if stream.over and not stream.ended and stream.source.life in ("lost", "away"):
            state = with_stream(state, name, replace(stream, ended=True, wanted=(), given=()))
            said.append(Say("ended", name, "its source is not heard"))
    return state, said


def _next_source(state: MissionState, name: str, now: float) -> MissionState:
    """Its substreams are left: the new process begins others, on the same detectors."""
    stream = state.streams[name]
    source = _next(stream.source, now, state)
    if source.life == "lost":
        return with_stream(state, name, replace(stream, source=source, ended=True, wanted=(), given=()))
    again = tuple(Opened(stream.next_number, o.assignment) for o in stream.wanted)
    known = {**state.known, **{opened.key: Known(opened) for opened in again}}
    return with_stream(replace(state, known=known), name, _begun_again(stream, source, again))


def _begun_again(stream: StreamState, source: Peer, wanted: tuple[Opened, ...]) -> StreamState:
    number = stream.next_number + 1
    return replace(stream, source=source, wanted=wanted, given=(), reported=-1, next_number=number)


def _next(peer: Peer, now: float, state: MissionState) -> Peer:
    if peer.losses > state.params.restarts:
        return replace(peer, restart_s=math.inf)
    return restarted(peer, now)


def _restart(actor: str, peer: Peer) -> list[Order]:
    if peer.life == "lost":
        return [Say("given up", actor, f"lost {peer.losses} times, last: {peer.reason}")]
    return [Restart(actor, peer.incarnation)]


def _is_due(peer: Peer, now: float) -> bool:
    return peer.life == "lost" and peer.restart_s <= now


def _sooner(peer: Peer, now: float, ended: bool) -> Peer:
    return replace(peer, restart_s=min(peer.restart_s, now)) if ended else peer

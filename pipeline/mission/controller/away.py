"""A site that nobody is heard of is cut off, and not broken: what runs there goes on by itself, and is left alone.

A radio that is away for half a minute silences every actor of a drone at once. To replace them would end what still
works: a source that sends to its own drone's machine, results that are kept for the map, frames that are kept for
later. So where all actors of a site fall silent together, nothing is planned anew and nobody is replaced, for
``away_s``. The scheduler's own hosts are not cut off from it: there silence is a fault of who is silent.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from pipeline.mission.controller.losses import SILENT, machine_lost, source_lost
from pipeline.mission.controller.orders import Order, Say
from pipeline.mission.controller.params import ControllerParams
from pipeline.mission.controller.peers import Peer, is_silent
from pipeline.mission.controller.state import (
    MissionState,
    machine_actor,
    source_actor,
    with_machine,
    with_stream,
)


def notice_cut_off(state: MissionState, now: float) -> tuple[MissionState, list[Order]]:
    """Leave sites alone that are cut off, and count as lost who does not come back with the others of a site."""
    said: list[Order] = []
    for site in state.problem.sites:
        if site in state.here:
            continue
        peers = dict(_peers(state, site))
        up = [peer for peer in peers.values() if peer.is_up]
        if any(is_silent(peer, now, state.params) for peer in up) and all(
            _is_quiet(peer, now, state.params) for peer in peers.values()
        ):
            for actor, peer in peers.items():
                if peer.is_up:
                    state = _with_peer(state, actor, replace(peer, life="away", since_s=now))
            said.append(Say("cut off", f"site:{site}", "what runs there goes on by itself"))
        for actor, peer in peers.items():
            reason = _why_lost(peer, up, now, state.params) if peer.life == "away" else None
            if reason is not None:
                state = _lost(state, actor, reason, now)
                said.append(Say("lost", actor, reason))
    return state, said


def _is_quiet(peer: Peer, now: float, params: ControllerParams) -> bool:
    """Whether nothing was heard of it since its last answer should have come; one that only starts says nothing yet."""
    return not peer.is_up or now - peer.heard_s > params.quiet_s


def _why_lost(peer: Peer, up: list[Peer], now: float, params: ControllerParams) -> str | None:
    if now - peer.since_s > params.away_s:
        return f"its site was cut off for {params.away_s:g} s"
    # the others of its site are heard again, and it is not
    if any(now - other.since_s > params.rejoin_s for other in up):
        return SILENT
    return None


def _peers(state: MissionState, site: str) -> Iterator[tuple[str, Peer]]:
    """The actors of a site that have not ended."""
    for machine in state.problem.machines:
        if machine.site == site:
            yield machine_actor(machine.id), state.machines[machine.id].peer
    for name, stream in state.streams.items():
        if not stream.ended and math.isinf(state.problem.link(name, site)):
            yield source_actor(name), stream.source


def _with_peer(state: MissionState, actor: str, peer: Peer) -> MissionState:
    kind, _, name = actor.partition(":")
    if kind == "machine":
        return with_machine(state, replace(state.machines[name], peer=peer))
    return with_stream(state, name, replace(state.streams[name], source=peer))


def _lost(state: MissionState, actor: str, reason: str, now: float) -> MissionState:
    kind, _, name = actor.partition(":")
    lost = machine_lost if kind == "machine" else source_lost
    return lost(state, name, reason, now, ended=False)

"""The life of one actor as the controller sees it: starting, up, away with its site, lost, started again."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from pipeline.mission.controller.params import ControllerParams

Life = Literal["starting", "up", "away", "lost"]


@dataclass(frozen=True)
class Peer:
    """One actor.

    incarnation: number of its process; what an older one says is not believed. since_s: begin of this life. heard_s:
    last report, or the start. losses: how often it was lost. restart_s: when its process is to be replaced.
    """

    life: Life
    since_s: float
    heard_s: float
    incarnation: int = 0
    losses: int = 0
    reason: str = ""
    restart_s: float = math.inf

    @property
    def is_up(self) -> bool:
        """Whether it can be counted on."""
        return self.life == "up"


def starting(now: float, incarnation: int = 0, losses: int = 0) -> Peer:
    """A process that was just started."""
    return Peer("starting", now, now, incarnation, losses)


def is_stale(peer: Peer, incarnation: int) -> bool:
    """Whether a report is of a process that was replaced since."""
    return incarnation < peer.incarnation


def heard(peer: Peer, now: float) -> Peer:
    """It has reported: it is up, also if it was thought lost."""
    if peer.is_up:
        return replace(peer, heard_s=now)
    return replace(peer, life="up", since_s=now, heard_s=now, reason="", restart_s=math.inf)


def excused(peer: Peer, away_s: float) -> Peer:
    """It could not be heard for so long, since nobody listened."""
    return replace(peer, heard_s=peer.heard_s + away_s)


def is_silent(peer: Peer, now: float, params: ControllerParams) -> bool:
    """Whether it should have been heard by now."""
    patience_s = params.boot_s if peer.life == "starting" else params.silence_s
    return peer.life in ("starting", "up") and now - peer.heard_s > patience_s


def lost(peer: Peer, reason: str, now: float, params: ControllerParams, *, ended: bool) -> Peer:
    """It cannot be counted on. ended: its process is known to be gone; a silent one is given time to come back."""
    wait_s = min(params.restart_backoff_s * 2.0**peer.losses, params.longest_backoff_s)
    wait_s += 0.0 if ended else params.replace_s
    return replace(
        peer, life="lost", since_s=now, reason=reason, losses=peer.losses + 1, restart_s=now + wait_s
    )


def restarted(peer: Peer, now: float) -> Peer:
    """Its next process is being started."""
    return starting(now, peer.incarnation + 1, peer.losses)

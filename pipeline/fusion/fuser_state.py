"""What a fuser knows beside its maps, as a copy that later results do not change."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from pipeline.fusion.fuser import Fuser
from pipeline.fusion.look import Look


@dataclass(frozen=True)
class FuserState:
    """looks, refused, unplaced, sizes, last_ns: see Fuser. newest: see Viewpoints."""

    looks: tuple[Look, ...]
    refused: dict[str, int]
    unplaced: dict[str, int]
    sizes: dict[tuple[str, int], int]
    last_ns: dict[tuple[str, str], int]
    newest: dict[str, tuple[int, float, float, float]]


def state_of(fuser: Fuser) -> FuserState:
    """A copy."""
    return FuserState(
        tuple(fuser.looks),
        dict(fuser.refused),
        dict(fuser.unplaced),
        dict(fuser.sizes),
        dict(fuser.last_ns),
        dict(fuser.viewpoints.newest),
    )


def restore(fuser: Fuser, state: FuserState) -> None:
    """Let a fuser know what it knew; its maps are left alone."""
    fuser.looks[:] = state.looks
    fuser.refused, fuser.unplaced = Counter(state.refused), Counter(state.unplaced)
    fuser.sizes, fuser.last_ns = Counter(state.sizes), dict(state.last_ns)
    fuser.viewpoints.newest = dict(state.newest)

"""Units of work that share the decoding of their source, in pieces of about equal cost for the workers."""

from __future__ import annotations

import math

from pipeline.evaluation.measuring.unit import Unit

#: about how many ms of one core a frame at 1024 x 576 costs: at no bitrate, and for each root of a Mbps more.
#: For the order of work and the time that remains
_FRAME_MS = {
    None: (2.0, 0.0),
    "h264": (4.6, 1.0),
    "h265": (10.9, 10.7),
    "vp9": (11.0, 2.4),
    "av1": (8.6, 3.0),
}
_LOOK_MS = 25.0
Bundle = tuple[Unit, ...]


def cost(unit: Unit) -> int:
    """Milliseconds, roughly."""
    least, more = _FRAME_MS[unit.condition.codec]
    frame_ms = least + more * math.sqrt((unit.condition.bitrate_bps or 0.0) / 1e6)
    return max(1, round(len(unit.kept) * frame_ms + len(unit.looked) * len(unit.models) * _LOOK_MS))


def bundles(units: list[Unit], workers: int) -> list[Bundle]:
    """The units in bundles of one sequence each, the costliest bundle first.

    A sequence makes no more bundles than it has codecs, so its source is decoded once for each of them at most;
    more only where workers would wait. Units whose stream is kept stay alone: they need no source.
    """
    made: list[Bundle] = [(u,) for u in units if _is_kept(u)]
    sequences: dict[str, list[Unit]] = {}
    for unit in units:
        if not _is_kept(unit):
            sequences.setdefault(unit.sequence, []).append(unit)
    for mine in sequences.values():
        codecs = len({u.condition.codec for u in mine} - {None}) or 1
        # fewer sequences than workers: as many pieces for each worker, or some would wait for the last
        several = len(sequences) < workers
        made += _dealt(mine, max(1, codecs // workers) * workers if several else codecs)
    return sorted(made, key=_cost, reverse=True)


def _dealt(units: list[Unit], count: int) -> list[Bundle]:
    """So many bundles of about equal cost: the dearest first, each to the one that has least."""
    piles: list[list[Unit]] = [[] for _ in range(min(count, len(units)))]
    for unit in sorted(units, key=cost, reverse=True):
        min(piles, key=lambda pile: sum(map(cost, pile))).append(unit)
    return [tuple(pile) for pile in piles]


def _is_kept(unit: Unit) -> bool:
    return unit.packets is not None and unit.packets.is_file()


def _cost(bundle: Bundle) -> int:
    return sum(map(cost, bundle))

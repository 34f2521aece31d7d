"""Units of work that share the decoding of their source, cut so that every worker has enough to do."""

from __future__ import annotations

from pipeline.evaluation.measuring.unit import Unit

#: about how many ms of one core a frame costs at 1024x576, for the order of work and the time that remains
_FRAME_MS = {None: 1.0, "h264": 5.0, "h265": 28.0, "vp9": 14.0, "av1": 12.0}
_LOOK_MS = 25.0
Bundle = tuple[Unit, ...]


def cost(unit: Unit) -> int:
    """Milliseconds, roughly."""
    encoded = len(unit.kept) * _FRAME_MS[unit.condition.codec]
    return max(1, round(encoded + len(unit.looked) * len(unit.models) * _LOOK_MS))


def bundles(units: list[Unit], workers: int) -> list[Bundle]:
    """Units of one sequence and codec together, the costliest first.

    The pictures as they are go with the sequence's cheapest codec. A bundle that is worth more than one
    worker's share of all is halved, and so each half decodes the source again. Units whose stream is kept
    stay alone: they need no source.
    """
    share = sum(map(cost, units)) / workers
    made = [part for bundle in _together(units) for part in _cut(bundle, share)]
    return sorted(made, key=_cost, reverse=True)


def _together(units: list[Unit]) -> list[Bundle]:
    alone: list[Bundle] = [(u,) for u in units if _is_kept(u)]
    groups: dict[tuple[str, str | None], list[Unit]] = {}
    for unit in units:
        if not _is_kept(unit):
            groups.setdefault((unit.sequence, unit.condition.codec), []).append(unit)
    for sequence, codec in list(groups):
        codecs = {c: group for (name, c), group in groups.items() if name == sequence and c is not None}
        if codec is None and codecs:
            cheapest = min(codecs.values(), key=lambda group: sum(map(cost, group)))
            cheapest += groups.pop((sequence, None))
    return alone + [tuple(group) for group in groups.values()]


def _is_kept(unit: Unit) -> bool:
    return unit.packets is not None and unit.packets.is_file()


def _cost(bundle: Bundle) -> int:
    return sum(map(cost, bundle))


def _cut(bundle: Bundle, most: float) -> list[Bundle]:
    """In halves of about equal cost, dear and cheap units by turns, until none costs more than the most."""
    if len(bundle) == 1 or _cost(bundle) <= most:
        return [bundle]
    dear_first = sorted(bundle, key=cost, reverse=True)
    return _cut(tuple(dear_first[::2]), most) + _cut(tuple(dear_first[1::2]), most)

"""Whether what the paper reports of codecs, bitrates and sizes holds on our pictures.

Each claim is judged by differences between cells under the same bootstrap draws: a difference counts if it
is greater than a hundredth and its 95 % interval does not hold zero.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from pipeline.config.mission import Codec
from pipeline.evaluation.bootstrap import interval
from pipeline.evaluation.cell import Cell
from pipeline.evaluation.matching import Size
from pipeline.evaluation.results import Results
from pipeline.messages import FloatArray

Verdict = Literal["holds", "does not hold", "cannot be told"]
#: a smaller difference in AP .5:.95 is of no use to anyone
_LEAST = 0.01
_UNHARMED_BPS = (1e6, 2.5e6)
_ORDER: tuple[Codec, ...] = ("h264", "vp9", "h265")
#: a detector is low and flat if it never has so much of the best one's AP, and loses less than this share
_LOW, _FLAT = 0.7, 0.25


@dataclass(frozen=True, slots=True)
class Shape:
    """A claim of the paper, whether it holds here, and what was found."""

    claim: str
    verdict: Verdict
    found: str


def shapes(results: Results) -> tuple[Shape, ...]:
    """All claims, in the paper's order."""
    return (
        _unharmed(results),
        _order_of_codecs(results),
        _small_first(results),
        _low_and_flat(results),
        _av1(results),
    )


def _unharmed(results: Results) -> Shape:
    claim = "Nothing is lost down to 2.5 or even 1 Mbps, with any codec."
    best_bps = max(results.bitrates_bps, default=0.0)
    judged, hurt = [], []
    for detector in results.detectors:
        for codec in results.codecs:
            top = results.cell(detector.id, codec, best_bps)
            for bitrate in (b for b in _UNHARMED_BPS if b < best_bps):
                low = results.cell(detector.id, codec, bitrate)
                if top is not None and low is not None and _ap(top) is not None:
                    judged.append(bitrate)
                    if _is_less(low, top):
                        hurt.append(
                            (bitrate, f"{detector.id} {codec} {_loss(low, top)} at {bitrate / 1e6:g} Mbps")
                        )
    if not judged:
        return Shape(claim, "cannot be told", "1 or 2.5 Mbps, or more than that, is not in the grid")
    lost = {bitrate for bitrate, _ in hurt}
    if not lost:
        return Shape(
            claim, "holds", f"no significant loss at {_mbps(judged)} against {best_bps / 1e6:g} Mbps"
        )
    words = "; ".join(text for _, text in hurt[:6]) + ("; .." if len(hurt) > 6 else "")
    return Shape(
        claim, "holds" if 2.5e6 not in lost and 2.5e6 in judged else "does not hold", f"lost: {words}"
    )


def _order_of_codecs(results: Results) -> Shape:
    claim = "Below 1 Mbps H.264 falls first, then VP9, H.265 last."
    codecs = [codec for codec in _ORDER if codec in results.codecs]
    low = [b for b in results.bitrates_bps if b < 1e6]
    if len(codecs) < 2 or not low:
        return Shape(claim, "cannot be told", "two of the codecs and a bitrate below 1 Mbps are needed")
    worth = {codec: float(np.mean(_aps(results, codec, low))) for codec in codecs}
    words = ", ".join(f"{codec} {worth[codec]:.3f}" for codec in sorted(codecs, key=worth.__getitem__))
    falls = all(worth[a] <= worth[b] for a, b in pairwise(codecs))
    found = f"mean AP .5:.95 over {', '.join(f'{b / 1e3:g}' for b in low)} kbps and all detectors: {words}"
    return Shape(claim, "holds" if falls else "does not hold", found)


def _small_first(results: Results) -> Shape:
    claim = "Small objects suffer first."
    best_bps = max(results.bitrates_bps, default=0.0)
    kept: dict[Size, list[float]] = {"small": [], "medium": []}
    for cell in (c for c in results.cells if c.codec is not None and c.bitrate_bps != best_bps):
        top = results.cell(cell.detector, cell.codec, best_bps)
        small, medium = _share(cell, top, "small"), _share(cell, top, "medium")
        # where both are gone or both are whole, there is no first
        if small is not None and medium is not None and min(small, medium) < 0.9 and max(small, medium) > 0.1:
            kept["small"].append(small)
            kept["medium"].append(medium)
    if not kept["small"]:
        return Shape(claim, "cannot be told", "no cell in which one of the two sizes suffers")
    of_small, of_medium = (float(np.mean(kept[size])) for size in ("small", "medium"))
    found = (
        f"of the AP .5:.95 at {best_bps / 1e6:g} Mbps, the {len(kept['small'])} cells that lose "
        f"some keep {of_small:.0%} for small people and {of_medium:.0%} for medium ones"
    )
    return Shape(claim, "holds" if of_small < of_medium else "does not hold", found)


def _low_and_flat(results: Results) -> Shape:
    claim = "The smallest networks are low and flat over all bitrates."
    fastest = min(results.timings, key=lambda t: t.mean_s, default=None)
    if fastest is None or len(results.detectors) < 2:
        return Shape(claim, "cannot be told", "two detectors with times are needed")
    own = [c for c in results.cells if c.detector == fastest.detector and c.codec is not None]
    others = [c for c in results.cells if c.detector != fastest.detector and c.codec is not None]
    aps, best = [_ap(c) or 0.0 for c in own], max((_ap(c) or 0.0 for c in others), default=0.0)
    low, flat = max(aps) < _LOW * best, min(aps) > (1.0 - _FLAT) * max(aps)
    found = (
        f"{fastest.detector}: AP .5:.95 {min(aps):.3f} to {max(aps):.3f}; best of the others {best:.3f}. "
        f"{'Low' if low else 'Not low'} (below {_LOW:.0%} of it), {'flat' if flat else 'not flat'} "
        f"(within {_FLAT:.0%} of its best)"
    )
    return Shape(claim, "holds" if low and flat else "does not hold", found)


def _av1(results: Results) -> Shape:
    claim = "AV1 promises 30 % less bitrate than H.265 or VP9 (the paper could not measure it)."
    low = [b for b in results.bitrates_bps if b < 1e6]
    if "av1" not in results.codecs or "h265" not in results.codecs or not low:
        return Shape(claim, "cannot be told", "AV1, H.265 and a bitrate below 1 Mbps are needed")
    av1, h265 = (float(np.mean(_aps(results, codec, low))) for codec in ("av1", "h265"))
    found = f"mean AP .5:.95 below 1 Mbps: AV1 {av1:.3f}, H.265 {h265:.3f}"
    return Shape(claim, "holds" if av1 > h265 else "does not hold", found)


def _aps(results: Results, codec: Codec, bitrates: Iterable[float]) -> list[float]:
    cells = (results.cell(d.id, codec, b) for d in results.detectors for b in bitrates)
    return [ap for cell in cells if cell is not None and (ap := _ap(cell)) is not None]


def _ap(cell: Cell) -> float | None:
    return cell.figures.ap


def _share(cell: Cell, top: Cell | None, size: Size) -> float | None:
    """What is left of the AP that the top cell has."""
    if top is None or not top.by_size[size].ap:
        return None
    return (cell.by_size[size].ap or 0.0) / (top.by_size[size].ap or 1.0)


def _is_less(cell: Cell, than: Cell) -> bool:
    lost = (_ap(than) or 0.0) - (_ap(cell) or 0.0)
    return lost > _LEAST and not _holds_zero(_draws(than) - _draws(cell))


def _holds_zero(differences: FloatArray) -> bool:
    """Whether the interval holds zero; without one (a single sequence) it does not."""
    low, high = interval(differences)
    return bool(low <= 0.0 <= high)


def _draws(cell: Cell) -> FloatArray:
    return np.array([np.nan if v is None else v for v in cell.replicates.ap], np.float64)


def _loss(cell: Cell, than: Cell) -> str:
    return f"-{(_ap(than) or 0.0) - (_ap(cell) or 0.0):.3f}"


def _mbps(bitrates: list[float]) -> str:
    return " and ".join(f"{b / 1e6:g} Mbps" for b in sorted(set(bitrates)))

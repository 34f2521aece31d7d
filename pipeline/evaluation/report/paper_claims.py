"""Whether what the paper reports of codecs, bitrates and sizes holds on our pictures.

Each claim is judged by differences between cells under the same bootstrap draws: a difference counts if it
is greater than a hundredth and its 95 % interval does not hold zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from pipeline.evaluation.metrics.bootstrap import interval
from pipeline.evaluation.metrics.cell import Cell
from pipeline.evaluation.metrics.matching import Size
from pipeline.evaluation.report.results import Results
from pipeline.link.codec import Codec
from pipeline.messages import FloatArray

Verdict = Literal["holds", "does not hold", "cannot be told"]
#: a smaller difference in AP .5:.95 is of no use to anyone
_LEAST = 0.01
_UNHARMED_BPS = (1e6, 2.5e6)
_BELOW_BPS = 1e6
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
        _order_as_asked(results),
        _order_as_obtained(results),
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


def _order_as_asked(results: Results) -> Shape:
    claim = (
        "Below 1 Mbps H.264 falls first, then VP9, H.265 last; at the bitrates asked for, as in the paper."
    )
    worth = {
        codec: value
        for codec in _ORDER
        if codec in results.codecs and (value := _worth_as_asked(results, codec)) is not None
    }
    return _ordered(claim, worth, f"below {_BELOW_BPS / 1e3:g} kbps, over all detectors and bitrates")


def _order_as_obtained(results: Results) -> Shape:
    claim = "The same at the bitrates that the encoders made of it (not in the paper)."
    return _ordered(claim, *_worth_below(results, _ORDER))


def _ordered(claim: str, worth: dict[Codec, float], where: str) -> Shape:
    """Whether the codecs' worth rises in the paper's order."""
    codecs = [codec for codec in _ORDER if codec in worth]
    if len(codecs) < 2:
        return Shape(claim, "cannot be told", "two of H.264, VP9 and H.265 at common bitrates are needed")
    words = ", ".join(f"{codec} {worth[codec]:.3f}" for codec in sorted(codecs, key=worth.__getitem__))
    falls = all(worth[a] <= worth[b] for a, b in pairwise(codecs))
    return Shape(claim, "holds" if falls else "does not hold", f"mean AP .5:.95 {where}: {words}")


def _worth_as_asked(results: Results, codec: Codec) -> float | None:
    """Mean AP over all detectors and bitrates asked for below 1 Mbps, whatever the encoder made of them."""
    low = [b for b in results.bitrates_bps if b < _BELOW_BPS]
    cells = [c for d in results.detectors for b in low if (c := results.cell(d.id, codec, b)) is not None]
    return float(np.mean([c.figures.ap or 0.0 for c in cells])) if cells else None


def _worth_below(results: Results, codecs: tuple[Codec, ...]) -> tuple[dict[Codec, float], str]:
    """Mean AP of each codec that was measured, over all detectors, where it was, in words.

    At equal bitrates as obtained, not as asked for: from the least that all codecs reach up to 1 Mbps.
    """
    measured = [codec for codec in codecs if codec in results.codecs]
    curves = {(d.id, c): _curve(results, d.id, c) for d in results.detectors for c in measured}
    known = [bps for bps, _ in curves.values() if len(bps)]
    low = max((float(bps[0]) for bps in known), default=_BELOW_BPS)
    if low >= 0.9 * _BELOW_BPS or len(known) < len(curves):
        return {}, "codecs that obtain a common bitrate below 1 Mbps are needed"
    at = np.geomspace(low, _BELOW_BPS, 9)
    worth = {
        codec: float(np.mean([np.interp(np.log(at), np.log(curves[d.id, codec][0]), curves[d.id, codec][1])
                              for d in results.detectors]))
        for codec in measured
    }  # fmt: skip
    return worth, f"at {low / 1e3:.0f} to {_BELOW_BPS / 1e3:g} kbps as obtained, over all detectors"


def _curve(results: Results, detector: str, codec: Codec) -> tuple[FloatArray, FloatArray]:
    """Bitrates obtained, rising, and AP at them."""
    cells = (results.cell(detector, codec, b) for b in results.bitrates_bps)
    points = sorted(
        (c.obtained_bps, c.figures.ap) for c in cells if c and c.obtained_bps and c.figures.ap is not None
    )
    return np.array([bps for bps, _ in points]), np.array([ap for _, ap in points])


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
    near = sum(ap > (1.0 - _FLAT) * max(aps) for ap in aps)
    low, flat = max(aps) < _LOW * best, near == len(aps)
    found = (
        f"{fastest.detector}: AP .5:.95 {min(aps):.3f} to {max(aps):.3f}; best of the others {best:.3f}. "
        f"{'Low' if low else 'Not low'} (below {_LOW:.0%} of it), {'flat' if flat else 'not flat'} "
        f"({near} of {len(aps)} cells are within {_FLAT:.0%} of its best)"
    )
    return Shape(claim, "holds" if low and flat else "does not hold", found)


def _av1(results: Results) -> Shape:
    claim = "AV1 promises 30 % less bitrate than H.265 or VP9 (the paper could not measure it)."
    worth, where = _worth_below(results, ("vp9", "h265", "av1"))
    if "av1" not in worth or len(worth) < 2:
        return Shape(claim, "cannot be told", where)
    words = ", ".join(f"{codec} {value:.3f}" for codec, value in sorted(worth.items(), key=lambda x: x[1]))
    best = worth["av1"] > max(value for codec, value in worth.items() if codec != "av1")
    return Shape(claim, "holds" if best else "does not hold", f"mean AP .5:.95 {where}: {words}")


def missed_targets(results: Results) -> list[str]:
    """Where an encoder missed its bitrate by more than a tenth, in words, each once."""
    found = {
        f"{c.codec} {c.bitrate_bps / 1e3:g} kbps: {c.obtained_bps / 1e3:.0f}"
        for c in results.cells
        if c.bitrate_bps and c.obtained_bps and abs(c.obtained_bps / c.bitrate_bps - 1.0) > 0.1
    }
    return sorted(found)


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
    lost = (_ap(than) or 0.0) - (_ap(cell) or 0.0)
    return f"-{lost:.3f} ({lost / (_ap(than) or 1.0):.0%})"


def _mbps(bitrates: list[float]) -> str:
    return " and ".join(f"{b / 1e6:g} Mbps" for b in sorted(set(bitrates)))

"""What one detector is worth under one condition: every metric, as a record that goes to a file and back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from pipeline.config.evaluation import Metric
from pipeline.evaluation.expected_size_classes import context_classes
from pipeline.evaluation.metrics.average_precision import SIZES, coco_precision
from pipeline.evaluation.metrics.bootstrap import interval, replicate
from pipeline.evaluation.metrics.boxes import FoundBoxes, IntArray, TrueBoxes
from pipeline.evaluation.metrics.lrp import is_at_cutoff, lrp_curve, optimal_lrp
from pipeline.evaluation.metrics.matching import Size, match
from pipeline.link.codec import Codec
from pipeline.messages import FloatArray

_PERSON = 1
_PRECISIONS = ("ap", "ap50", "ap75", "ar1", "ar10", "ar100")
_Boxes = TypeVar("_Boxes", TrueBoxes, FoundBoxes)


class _Record(BaseModel):
    """A missing figure is None: JSON has no NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Figures(_Record):
    """COCO's AP and AR, and oLRP with its parts (moLRP too: there is one class), of one set of boxes.

    people: to be found. threshold: score where LRP is least, None if it is best to report nothing.
    at_cutoff: that threshold is the detector's cut-off, so that the true optimum lies lower.
    """

    people: int
    ap: float | None
    ap50: float | None
    ap75: float | None
    ar1: float | None
    ar10: float | None
    ar100: float | None
    molrp: float | None
    localisation: float | None
    false_positive: float | None
    false_negative: float | None
    threshold: float | None
    at_cutoff: bool

    def value(self, metric: Metric) -> float | None:
        """A metric by name; greater is better."""
        if metric == "one_minus_molrp":
            return None if self.molrp is None else 1.0 - self.molrp
        value: float | None = getattr(self, metric)
        return value


class ContextFigures(_Record):
    """Figures of the pictures in which a person is expected to be so large; above_px None: without end."""

    from_px: float
    below_px: float | None
    pictures: int
    figures: Figures


class Replicated(_Record):
    """Of each bootstrap draw, the same draws in every cell; empty with fewer than two sequences."""

    ap: tuple[float | None, ...]
    ap50: tuple[float | None, ...]
    ar100: tuple[float | None, ...]
    molrp: tuple[float | None, ...]


class Cell(_Record):
    """One detector under one codec and bitrate (None: the pictures as they are).

    obtained_bps: what the encoder made of it. largest_packet_s: of the link at the bitrate asked for.
    """

    detector: str
    codec: Codec | None
    bitrate_bps: float | None
    obtained_bps: float | None
    largest_packet_s: float | None
    pictures: int
    by_size: dict[Size, Figures]
    by_context: tuple[ContextFigures, ...]
    intervals: dict[Metric, tuple[float | None, float | None]]
    replicates: Replicated
    not_finite: int

    @property
    def figures(self) -> Figures:
        """Of boxes of every size."""
        return self.by_size["all"]


@dataclass(frozen=True, eq=False)
class Sample:
    """The pictures that are looked at, numbered 0 .. images - 1, and the truth in them.

    expected_px: float64 (images,), NaN where it is not known. weights: bootstrap draws (R, images).
    """

    images: int
    truth: TrueBoxes
    expected_px: FloatArray
    weights: FloatArray


def measure(sample: Sample, found: FoundBoxes, cutoff: float) -> dict[str, Any]:
    """by_size, by_context, intervals and replicates of a cell."""
    draws = replicate(match(sample.truth, found), sample.weights)
    return {
        "by_size": figures(sample.truth, found, sample.images, cutoff),
        "by_context": _by_context(sample, found, cutoff),
        "intervals": {
            "ap": _pair(interval(draws.ap)),
            "ap50": _pair(interval(draws.ap50)),
            "ar100": _pair(interval(draws.ar100)),
            "one_minus_molrp": _pair(interval(1.0 - draws.molrp)),
        },
        "replicates": Replicated(
            ap=_column(draws.ap),
            ap50=_column(draws.ap50),
            ar100=_column(draws.ar100),
            molrp=_column(draws.molrp),
        ),
    }


def figures(true: TrueBoxes, found: FoundBoxes, images: int, cutoff: float) -> dict[Size, Figures]:
    """By size class, of pictures 0 .. images - 1; all boxes are of one category."""
    coco = coco_precision(true, found, images, [_PERSON])
    out: dict[Size, Figures] = {}
    for size in SIZES:
        matches = match(true, found, size, np.array([0.5]))
        lrp = optimal_lrp(lrp_curve(matches, _PERSON))
        precision = coco.by_size[size]
        out[size] = Figures(
            people=len(matches.true_image),
            **{name: _known(getattr(precision, name)) for name in _PRECISIONS},
            molrp=_known(lrp.lrp),
            localisation=_known(lrp.localisation),
            false_positive=_known(lrp.false_positive),
            false_negative=_known(lrp.false_negative),
            threshold=_known(lrp.threshold),
            at_cutoff=is_at_cutoff(lrp.threshold, cutoff),
        )
    return out


def _by_context(sample: Sample, found: FoundBoxes, cutoff: float) -> tuple[ContextFigures, ...]:
    rows = []
    for low, high in context_classes():
        chosen = np.flatnonzero((sample.expected_px >= low) & (sample.expected_px < high))
        if len(chosen):
            of_chosen = figures(only(sample.truth, chosen), only(found, chosen), len(chosen), cutoff)
            above = None if math.isinf(high) else high
            rows.append(
                ContextFigures(from_px=low, below_px=above, pictures=len(chosen), figures=of_chosen["all"])
            )
    return tuple(rows)


def only(boxes: _Boxes, pictures: IntArray) -> _Boxes:
    """The boxes of some pictures, rising numbers, renumbered 0, 1, .. in their order."""
    kept = boxes.rows(np.isin(boxes.image, pictures))
    return replace(kept, image=np.searchsorted(pictures, kept.image))


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _pair(values: tuple[float, float]) -> tuple[float | None, float | None]:
    return _known(values[0]), _known(values[1])


def _column(values: FloatArray) -> tuple[float | None, ...]:
    return tuple(_known(round(float(v), 6)) for v in values)

"""The pool that allocation reads, from an evaluation's results."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import yaml

from pipeline.config.base import FORMAT_VERSION
from pipeline.config.pool import load_pool
from pipeline.errors import InputError
from pipeline.evaluation.measuring.operating_points import MeasuredOperatingPoint
from pipeline.evaluation.measuring.setup_timing import SetupTiming
from pipeline.evaluation.metrics.cell import Cell
from pipeline.evaluation.report.results import DetectorFile, Results
from pipeline.storage.whole_or_nothing import replacing

_MEMORY_MARGIN = 1.25
#: pictures as they are have no bitrate; the pool wants one, and from this one on video loses no accuracy
AS_THEY_ARE_BPS = 20e6
_METRICS = {
    "ap": "AP .5:.95",
    "ap50": "AP .5",
    "ap75": "AP .75",
    "ar1": "AR .5:.95, 1 box",
    "ar10": "AR .5:.95, 10 boxes",
    "ar100": "AR .5:.95, 100 boxes",
    "one_minus_molrp": "1 - moLRP",
}


def write_pool(path: Path, results: Results) -> None:
    """Write the pool file and read it back. Raises InputError if allocation could not use it."""
    document = pool_document(results, path.parent)
    with replacing(path) as temporary:
        temporary.write_text(yaml.safe_dump(document, sort_keys=False, width=110), encoding="utf-8")
        load_pool(temporary)


def pool_document(results: Results, folder: Path) -> dict[str, Any]:
    """What the pool file says; folder: where it will lie."""
    return {
        "version": FORMAT_VERSION,
        "provenance": _provenance(results),
        "assumed": [f"{d.id}: {_assumed(results)}" for d in results.detectors if _of_stills(results)],
        "detectors": [_detector(results, d, folder) for d in results.detectors],
    }


def _of_stills(results: Results) -> bool:
    return not results.bitrates_bps


def assumed_as_they_are(pictures: int, people: int) -> str:
    """What a row of pictures that were not encoded takes for granted."""
    return f"accuracy of pictures as they are ({pictures} pictures, {people} people), not of encoded video"


def _assumed(results: Results) -> str:
    return assumed_as_they_are(results.provenance.pictures, results.provenance.people)


def _provenance(results: Results) -> dict[str, Any]:
    p = results.provenance
    what = (
        "simulated-scene accuracy, not measured on real video" if p.simulated else "measured on real pictures"
    )
    under = "of pictures as they are" if _of_stills(results) else f"under {results.codec}"
    elsewhere = [d.id for d in results.detectors if d.scores_given]
    given = (
        f"of {', '.join(elsewhere)} as the evaluation file gives it, from other pictures" if elsewhere else ""
    )
    return {
        "accuracy": f"{_METRICS[results.metric]} {under}; {what}",
        "people": f"{p.people} in {p.pictures} pictures of {len(p.sequences)} sequences",
        "sizes": ", ".join(f"{size} {share:.0%}" for size, share in p.size_mix.items()),
        "score_threshold": given or "where LRP is least, over all conditions",
        "calibration": given or "of the scores above it, at IoU 0.5, over all conditions",
        "memory": f"peak of a process of its own, times {_MEMORY_MARGIN:g}",
        "times": "per picture, from pixels to boxes, warm-up left out",
        "evaluation": p.evaluation,
        "evaluation_sha256": p.evaluation_sha256,
        "dataset_sha256": p.dataset_sha256,
        "machine": f"{p.machine}, {p.cores} cores",
        "versions": p.versions,
        "date": p.date,
        "command": "searchlight evaluate",
    } | ({"faults": list(p.faults)} if p.faults else {})


def _detector(results: Results, detector: DetectorFile, folder: Path) -> dict[str, Any]:
    cells = [c for c in results.cells if c.detector == detector.id]
    own_codec = [c for c in cells if c.codec == (None if _of_stills(results) else results.codec)]
    timings = [t for t in results.timings if t.detector == detector.id]
    if not timings:
        raise InputError("timing", "no setup", "timing.setups, since a pool needs times and memory")
    accuracy = [_at(c) | {"accuracy": a} for c in own_codec if (a := _accuracy(results, c)) is not None]
    if not accuracy:
        under = "of pictures as they are" if _of_stills(results) else f"under {results.codec}"
        raise InputError("pool", f"no {results.metric} {under}", "what was measured, with people to find")
    document: dict[str, Any] = {
        "id": detector.id,
        "model": os.path.relpath(detector.model, folder),
        "sha256": detector.sha256,
        "memory": {"megabytes": _megabytes(timings)},
        "score_threshold": detector.score_threshold,
        "calibration": None if detector.calibration is None else detector.calibration.model_dump(),
        "accuracy": accuracy,
        "accuracy_by_size": [row for c in own_codec for row in _by_size(results, c)],
        "accuracy_by_codec": [row for c in cells for row in _with_codec(results, c)],
        "accuracy_by_context": [row for c in own_codec for row in _in_context(results, c)],
        "operating_points": [operating_point_row(point) for point in detector.operating_points],
        "times": [time_row(t) for t in timings],
    }
    if detector.card is not None:
        document["card"] = os.path.relpath(detector.card, folder)
    if _of_stills(results):
        document["assumed"] = _assumed(results)
    sharing = sharing_rows(timings)
    return document | ({"sharing": sharing} if sharing else {})


def operating_point_row(point: MeasuredOperatingPoint) -> dict[str, Any]:
    """The pool's row of a measured operating point."""
    row = point.model_dump(exclude={"bitrate_bps", "right", "wrong"}, exclude_none=True)
    return row | {"bitrate": {"kbps": point.bitrate_bps / 1e3}, "found": list(row["found"])}


def _accuracy(results: Results, cell: Cell) -> float | None:
    return _rounded(cell.figures.value(results.metric))


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(min(max(value, 0.0), 1.0), 4)


def _at(cell: Cell) -> dict[str, Any]:
    return {"bitrate": {"kbps": (cell.bitrate_bps or AS_THEY_ARE_BPS) / 1e3}}


def _by_size(results: Results, cell: Cell) -> list[dict[str, Any]]:
    return [
        _at(cell) | {"size": size, "accuracy": accuracy}
        for size, figures in cell.by_size.items()
        if size != "all" and (accuracy := _rounded(figures.value(results.metric))) is not None
    ]


def _with_codec(results: Results, cell: Cell) -> list[dict[str, Any]]:
    accuracy = _accuracy(results, cell)
    if cell.codec is None or accuracy is None:
        return []
    row = {"codec": cell.codec} | _at(cell) | {"accuracy": accuracy}
    low, high = cell.intervals.get(results.metric, (None, None))
    if low is not None and high is not None:
        row |= {"low": _rounded(low), "high": _rounded(high)}
    if cell.obtained_bps:
        row["obtained"] = {"kbps": round(cell.obtained_bps / 1e3, 1)}
    if cell.largest_packet_s:
        row["largest_packet"] = {"milliseconds": round(1e3 * cell.largest_packet_s, 2)}
    return [row]


def _in_context(results: Results, cell: Cell) -> list[dict[str, Any]]:
    rows = []
    for context in cell.by_context:
        accuracy = _rounded(context.figures.value(results.metric))
        if accuracy is not None:
            row = _at(cell) | {"person_px_from": context.from_px, "accuracy": accuracy}
            below = {} if context.below_px is None else {"person_px_below": context.below_px}
            rows.append(row | below)
    return rows


def _megabytes(timings: list[SetupTiming]) -> int:
    return math.ceil(max(t.memory_bytes for t in timings) * _MEMORY_MARGIN / 1e6)


def time_row(timing: SetupTiming) -> dict[str, Any]:
    """The pool's row of a measured setup."""
    named = {
        "mean": timing.mean_s,
        "maximum": timing.maximum_s,
        "minimum": timing.minimum_s,
        "p95": timing.p95_s,
    }
    return (
        {"machine": timing.machine}
        | {name: {"milliseconds": round(1e3 * value, 3)} for name, value in named.items()}
        | {"provider": timing.provider, "threads": timing.threads}
    )


def sharing_rows(timings: list[SetupTiming]) -> list[dict[str, Any]]:
    """The worst factor of all setups."""
    worst: dict[int, float] = {}
    for timing in timings:
        for count, factor in timing.sharing.items():
            worst[count] = max(factor, worst.get(count, 1.0))
    return [{"detectors": count, "factor": round(worst[count], 3)} for count in sorted(worst)]

"""The results as CSV: one row for each cell and size class, and one for each setup."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from typing import Any

from pipeline.config.evaluation import Metric
from pipeline.evaluation.metrics.cell import Cell, Figures
from pipeline.evaluation.report.results import Results

_FIGURES = tuple(Figures.model_fields)
_INTERVALS: tuple[Metric, ...] = ("ap", "ap50", "ar100", "one_minus_molrp")
CELL_COLUMNS = (
    "detector",
    "codec",
    "bitrate_kbps",
    "obtained_kbps",
    "largest_packet_s",
    "pictures",
    "size",
    *_FIGURES,
    *(f"{name}_{end}" for name in _INTERVALS for end in ("low", "high")),
)

_TIME_COLUMNS = (
    "detector",
    "machine",
    "provider",
    "threads",
    "clock",
    "pictures",
    "minimum_ms",
    "mean_ms",
    "p95_ms",
    "maximum_ms",
    "memory_mb",
    "sharing",
    "busy",
)


def cells_csv(results: Results) -> str:
    """Every cell; the pictures as they are have the codec ``source``. Sizes in context: person_px_FROM."""
    return _csv(CELL_COLUMNS, (row for cell in results.cells for row in _rows(cell)))


def _rows(cell: Cell) -> Iterable[list[Any]]:
    own = [
        cell.detector,
        cell.codec or "source",
        _kbps(cell.bitrate_bps),
        _kbps(cell.obtained_bps),
        _rounded(cell.largest_packet_s),
    ]
    empty = [None] * (2 * len(_INTERVALS))
    for size, figures in cell.by_size.items():
        ends = [end for name in _INTERVALS for end in cell.intervals[name]] if size == "all" else empty
        yield [*own, cell.pictures, size, *_values(figures), *map(_rounded, ends)]
    for context in cell.by_context:
        name = f"person_px_{context.from_px:g}"
        yield [*own, context.pictures, name, *_values(context.figures), *empty]


def _values(figures: Figures) -> list[Any]:
    return [_rounded(getattr(figures, name)) for name in _FIGURES]


def _kbps(bps: float | None) -> float | None:
    return None if bps is None else round(bps / 1e3, 3)


def _rounded(value: Any) -> Any:
    return round(value, 6) if isinstance(value, float) else value


def times_csv(results: Results) -> str:
    """Every setup; milliseconds and megabytes; slow-downs as N:FACTOR."""
    rows = (
        [t.detector, t.machine, t.provider, t.threads, t.clock, t.pictures]
        + [round(1e3 * s, 4) for s in (t.minimum_s, t.mean_s, t.p95_s, t.maximum_s)]
        + [round(t.memory_bytes / 1e6, 2), " ".join(f"{n}:{f:.3f}" for n, f in sorted(t.sharing.items()))]
        + [_rounded(t.busy)]
        for t in results.timings
    )
    return _csv(_TIME_COLUMNS, rows)


def _csv(columns: tuple[str, ...], rows: Iterable[list[Any]]) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return buffer.getvalue()

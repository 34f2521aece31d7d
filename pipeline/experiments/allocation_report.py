"""The allocation experiment as a table: for the terminal, in Markdown and in JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from pipeline.experiments.allocation_times import REPEATS, CellResult
from pipeline.experiments.literal_process import Answer
from pipeline.experiments.paper_tables import CELLS, printed_size
from pipeline.storage.whole_or_nothing import write_text

COLUMNS = (
    "dps",
    "streams",
    "paper s",
    "literal s",
    "CPU",
    "ours s",
    "CPU",
    "speed-up",
    "status",
    "gap",
    "same",
    "paper's size",
    "size",
    "ours",
)
TITLES = {
    "ilp_eval1a": "Table ilp_eval1 (a): 1 Mbps, 6 bitrate levels",
    "ilp_eval1b": "Table ilp_eval1 (b): 20 Mbps, 9 bitrate levels",
    "ilp_eval2": "Table ilp_eval2: 20 Mbps, 9 bitrate levels",
}
NOTES = (
    "dps: detectors per stream. Seconds are wall time, the building of the model included; ours is the "
    f"fastest of {REPEATS}, after a first one that lets numba compile. CPU: its CPU seconds. speed-up: "
    "that of CPU seconds, since both use one thread and the machine may do other things.",
    "*: infeasible. >: ended by the limit. -: not asked. same: status and objective are the literal model's.",
    "size: variables:constraints of the paper's program by its formulas. At 1 Mbps the text has 6 bitrate "
    "levels, which are solved here; the printed numbers of variables are those of 8, which are counted here. "
    "ours: columns:rows of our master problem.",
)
_LONG_S = 30.0


def table_rows(results: Sequence[CellResult], table: str) -> list[tuple[str, ...]]:
    """One row of text per cell of one of the paper's tables, under COLUMNS."""
    return [_row(result) for result in results if result.cell.table == table]


def summary_lines(results: Sequence[CellResult]) -> list[str]:
    """What the issue asks of all cells, counted."""
    if not results:
        return ["no cell is measured yet"]
    closed = sum(r.ours.status == "optimal" and r.ours.gap == 0.0 for r in results)
    infeasible = sum(r.ours.status == "infeasible" for r in results)
    compared = [r.as_the_paper for r in results if r.as_the_paper is not None]
    same = [r.same for r in results if r.same is not None]
    slowest = max(results, key=lambda r: r.ours.seconds)
    lines = [
        f"{len(results)} of {len(CELLS)} cells: {closed} optimal with gap 0, {infeasible} infeasible, "
        f"{sum(bool(r.faults) for r in results)} plans with faults",
        f"feasible or infeasible as the paper says: {sum(compared)} of {len(compared)}",
        f"as the literal model says: {sum(same)} of {len(same)} where it came to an end",
        f"slowest of ours: {slowest.ours.seconds:.3f} s ({slowest.cell.name})",
    ]
    return [*lines, *_speed_up_line(results)]


def _speed_up_line(results: Sequence[CellResult]) -> list[str]:
    speed_ups = {
        r.cell.name: r.speed_up
        for r in results
        if r.speed_up is not None and r.literal is not None and (r.literal.cpu_seconds or 0.0) > _LONG_S
    }
    if not speed_ups:
        return []
    name = min(speed_ups, key=speed_ups.__getitem__)
    return [
        f"least speed-up of the {len(speed_ups)} cells where the literal model ends after more than "
        f"{_LONG_S:g} s of CPU: {speed_ups[name]:.0f} ({name})"
    ]


def write_report(out: Path, results: Sequence[CellResult]) -> None:
    """Write OUT/report.md and, last, OUT/results.json."""
    parts = ["# Detector allocation: the paper's times, the literal model's and ours"]
    for table, title in TITLES.items():
        if rows := table_rows(results, table):
            parts += [f"## {title}", _markdown(rows)]
    parts += ["\n".join(f"- {line}" for line in summary_lines(results)), *NOTES]
    write_text(out / "report.md", "\n\n".join(parts) + "\n")
    document = {"summary": summary_lines(results), "cells": [_record(result) for result in results]}
    write_text(out / "results.json", json.dumps(document, indent=1, allow_nan=False) + "\n")


def _row(result: CellResult) -> tuple[str, ...]:
    cell, ours = result.cell, result.ours
    variables, constraints = (printed_size(count) for count in result.size)
    return (
        str(cell.detectors_per_stream),
        str(cell.streams),
        cell.printed,
        _literal_seconds(result),
        _cpu(result.literal, 1),
        f"{ours.seconds:.3f}" + ("*" if ours.status == "infeasible" else ""),
        _cpu(ours, 3),
        "" if result.speed_up is None else f"{result.speed_up:.0f}",
        ours.status,
        "" if ours.gap is None else f"{ours.gap:g}",
        "" if result.same is None else "yes" if result.same else "NO",
        cell.size,
        f"{variables}:{constraints}",
        f"{result.master[0]}:{result.master[1]}",
    )


def _literal_seconds(result: CellResult) -> str:
    if result.literal is None:
        return "-"
    if not result.literal.proven:
        return f">{result.literal_limit_s:g}"
    return f"{result.literal.seconds:.1f}" + ("*" if result.literal.status == "infeasible" else "")


def _cpu(answer: Answer | None, digits: int) -> str:
    return "" if answer is None or answer.cpu_seconds is None else f"{answer.cpu_seconds:.{digits}f}"


def _markdown(rows: Sequence[tuple[str, ...]]) -> str:
    lines = [COLUMNS, ("---:",) * len(COLUMNS), *rows]
    return "\n".join("| " + " | ".join(cell.replace("*", "\\*") for cell in line) + " |" for line in lines)


def _record(result: CellResult) -> dict[str, object]:
    derived = {"speed_up": result.speed_up, "same": result.same, "as_the_paper": result.as_the_paper}
    return {**asdict(result), **derived}

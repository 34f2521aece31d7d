"""The picture of a schedule, after the paper's figure of assignments (Figure dpf)."""

from __future__ import annotations

import io

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pipeline.allocation.plan import Assignment, Plan
from pipeline.allocation.problem import Problem

_BAR_HEIGHT = 0.62
_ROW_INCHES = 0.32
_COLORS = ("#4878a8", "#e49444", "#6a9f58", "#d1615d", "#967662", "#a87c9f", "#85b6b2", "#e7ca60")
MAX_FRAMES = 60


def gantt(problem: Problem, plan: Plan, cycles: int = 2) -> Figure:
    """One block per stream, one row per assigned detector: frames marked x, execution as bars.

    Shows ``cycles`` cycles, at least 6 and at most MAX_FRAMES frames. Rows of one detector have one colour.
    """
    frames = min(max(6, cycles * plan.cycle), MAX_FRAMES)
    streams = sorted({a.stream for a in plan.assignments}) or list(problem.streams)
    rows = [[a for a in plan.assignments if a.stream == stream] for stream in streams]
    heights = [max(1, len(assigned)) for assigned in rows]
    figure = Figure(
        figsize=(10.0, 0.9 + 0.3 * len(streams) + _ROW_INCHES * sum(heights)), layout="constrained"
    )
    FigureCanvasAgg(figure)
    blocks = figure.subplots(len(streams), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for axes, stream, assigned in zip(blocks, streams, rows, strict=True):
        _draw_stream(axes, stream, assigned, problem, frames)
    blocks[-1].set_xlabel(
        f"frame of the schedule, {problem.frame_rate_hz:g} per second (cycle: {plan.cycle})"
    )
    return figure


def gantt_png(problem: Problem, plan: Plan, cycles: int = 2) -> bytes:
    """The same as a PNG file."""
    buffer = io.BytesIO()
    gantt(problem, plan, cycles).savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()


def _draw_stream(axes: Axes, stream: str, assigned: list[Assignment], problem: Problem, frames: int) -> None:
    for row, a in enumerate(assigned):
        _draw_row(axes, row, a, problem, frames)
    labels = [f"{a.pool_detector}\n{a.machine}, {a.bitrate_bps / 1e6:g} Mbps" for a in assigned]
    axes.set_yticks(range(len(assigned)), labels, fontsize=7)
    axes.set_ylim(max(1, len(assigned)) - 0.5, -0.5)
    axes.set_xlim(-0.5, frames)
    axes.set_title(stream, loc="left", fontsize=9)
    axes.grid(axis="x", linewidth=0.4, alpha=0.5)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_row(axes: Axes, row: int, a: Assignment, problem: Problem, frames: int) -> None:
    names = sorted({d.detector for d in problem.detectors})
    execution_s = next(d.execution_s for d in problem.detectors if d.id == a.detector)
    starts = range(a.phase, frames, a.period)
    axes.broken_barh(
        [(start, execution_s * problem.frame_rate_hz) for start in starts],
        (row - _BAR_HEIGHT / 2, _BAR_HEIGHT),
        facecolors=_COLORS[names.index(a.pool_detector) % len(_COLORS)],
        alpha=0.75,
    )
    axes.plot(starts, [row] * len(starts), "x", color="black", markersize=5)

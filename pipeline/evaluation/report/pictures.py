"""The paper's figures of our results: accuracy and errors against bitrate, times, and pictures at 50 kbps."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, NullFormatter, NullLocator
from numpy.typing import NDArray

from pipeline.config.evaluation import Metric
from pipeline.evaluation.metrics.cell import Cell, ContextFigures
from pipeline.evaluation.metrics.matching import Size
from pipeline.evaluation.report.results import Results
from pipeline.link.codec import Codec
from pipeline.messages import FloatArray

#: after Okabe and Ito: apart from each other, also for the colour-blind
DETECTOR_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#882255", "#332288", "#999933")
_CODEC_STYLES: dict[Codec, tuple[str, str]] = {
    "h264": ("-", "o"), "h265": ("--", "s"), "vp9": ("-.", "^"), "av1": (":", "D"),
}  # fmt: skip
CODEC_NAMES: dict[Codec, str] = {"h264": "H.264", "h265": "H.265", "vp9": "VP9", "av1": "AV1"}
_DPI = 110
#: of a cell, the value to draw and its interval, either None if there is none
_Value = Callable[[Cell], float | None]


def accuracy_picture(results: Results) -> Figure:
    """AP at three IoUs, and AR with at most 10 boxes, against bitrate."""
    panels: list[tuple[str, _Value]] = [
        ("AP .5", lambda c: c.figures.ap50),
        ("AP .75", lambda c: c.figures.ap75),
        ("AP .5:.95", lambda c: c.figures.ap),
        ("AR .5:.95, 10 boxes", lambda c: c.figures.ar10),
    ]
    bands: dict[str, Metric] = {"AP .5": "ap50", "AP .5:.95": "ap"}
    return _against_bitrate(results, [panels], bands)


def size_picture(results: Results) -> Figure:
    """AP (top) and AR (bottom) at IoU .5:.95 of small, medium and large people, against bitrate."""
    rows = [
        [
            (f"{name} .5:.95, {_sized(results, size)}", _of_size(size, field))
            for size in ("small", "medium", "large")
        ]
        for name, field in (("AP", "ap"), ("AR", "ar10"))
    ]
    return _against_bitrate(results, rows)


def _sized(results: Results, size: Size) -> str:
    people = max((c.by_size[size].people for c in results.cells), default=0)
    return f"{size} ({people or 'no'} people)"


def _of_size(size: Size, field: str) -> _Value:
    return lambda cell: getattr(cell.by_size[size], field)


def lrp_picture(results: Results) -> Figure:
    """1 - moLRP and its parts, each so that up is better; cells at the cut-off are drawn hollow."""

    def of(field: str) -> _Value:
        def value(cell: Cell) -> float | None:
            part: float | None = getattr(cell.figures, field)
            return None if part is None else 1.0 - part

        return value

    panels = [
        ("1 - moLRP", of("molrp")),
        ("1 - moLRP IoU (where)", of("localisation")),
        ("1 - moLRP FP (invented)", of("false_positive")),
        ("1 - moLRP FN (missed)", of("false_negative")),
    ]
    return _against_bitrate(results, [panels], {"1 - moLRP": "one_minus_molrp"}, mark_cutoff=True)


def _against_bitrate(
    results: Results,
    rows: list[list[tuple[str, _Value]]],
    bands: dict[str, Metric] | None = None,
    mark_cutoff: bool = False,
) -> Figure:
    columns = len(rows[0])
    figure = Figure(figsize=(3.9 * columns, 3.3 * len(rows) + 0.9), dpi=_DPI, layout="constrained")
    grid = figure.subplots(len(rows), columns, squeeze=False, sharey="row")
    for axes_row, panels in zip(grid, rows, strict=True):
        for axes, (title, value) in zip(axes_row, panels, strict=True):
            _lines(axes, results, value, (bands or {}).get(title), mark_cutoff)
            axes.set_title(title, fontsize=11)
            axes.set_ylim(0.0, 1.02)
            axes.grid(visible=True, which="major", alpha=0.3)
            _bitrate_axis(axes, results)
    figure.legend(
        handles=_legend(results, mark_cutoff), loc="outside lower center", ncols=6, frameon=False, fontsize=9
    )
    return figure


def _lines(axes: Axes, results: Results, value: _Value, band: Metric | None, mark_cutoff: bool) -> None:
    for k, detector in enumerate(results.detectors):
        color = DETECTOR_COLORS[k % len(DETECTOR_COLORS)]
        for codec in results.codecs:
            cells = [
                c for b in results.bitrates_bps if (c := results.cell(detector.id, codec, b)) is not None
            ]
            cells = [c for c in cells if value(c) is not None]
            if not cells:
                continue
            x = [c.bitrate_bps for c in cells]
            y = [value(c) for c in cells]
            style, marker = _CODEC_STYLES[codec]
            axes.plot(x, y, style, color=color, lw=1.4)  # type: ignore[arg-type]
            hollow = [mark_cutoff and c.figures.at_cutoff for c in cells]
            faces = ["white" if h else color for h in hollow]
            axes.scatter(x, y, s=20, marker=marker, c=faces, edgecolors=color, linewidths=1.0, zorder=3)  # type: ignore[arg-type]
            # one codec's band is enough: those of the others lie on it
            if band is not None and codec == results.codec:
                _band(axes, cells, band, color)


def _band(axes: Axes, cells: list[Cell], band: Metric, color: str) -> None:
    known = [(c.bitrate_bps, *c.intervals[band]) for c in cells if c.intervals[band][0] is not None]
    if known:
        x, low, high = zip(*known, strict=True)
        axes.fill_between(x, low, high, color=color, alpha=0.07, lw=0)


def _bitrate_axis(axes: Axes, results: Results) -> None:
    axes.set_xscale("log")
    axes.set_xlim(0.8 * results.bitrates_bps[0], 1.25 * results.bitrates_bps[-1])
    axes.set_xticks(list(results.bitrates_bps))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda bps, _: bitrate_name(bps)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(axis="x", labelrotation=60, labelsize=8)


def bitrate_name(bps: float) -> str:
    """As short as it can be said: 50k, 2.5M."""
    return f"{bps / 1e6:g}M" if bps >= 1e6 else f"{bps / 1e3:g}k"


def _legend(results: Results, mark_cutoff: bool) -> list[Line2D]:
    handles = [
        Line2D([], [], color=DETECTOR_COLORS[k % len(DETECTOR_COLORS)], lw=3, label=d.id)
        for k, d in enumerate(results.detectors)
    ]
    handles += [
        Line2D(
            [],
            [],
            color="#444444",
            ls=_CODEC_STYLES[c][0],
            marker=_CODEC_STYLES[c][1],
            ms=5,
            label=CODEC_NAMES[c],
        )
        for c in results.codecs
    ]
    if mark_cutoff:
        handles.append(
            Line2D(
                [], [], ls="", marker="o", mfc="white", mec="#444444", label="optimum at the score cut-off"
            )
        )
    return handles


def time_picture(results: Results) -> Figure:
    """Minimum, mean and maximum seconds for each picture, on a log axis."""
    figure = Figure(figsize=(7.5, 0.9 + 0.42 * max(len(results.timings), 2)), dpi=_DPI, layout="constrained")
    axes = figure.subplots()
    names = [d.id for d in results.detectors]
    for row, t in enumerate(results.timings):
        color = DETECTOR_COLORS[names.index(t.detector) % len(DETECTOR_COLORS)]
        low, mean, p95, high = (1e3 * s for s in (t.minimum_s, t.mean_s, t.p95_s, t.maximum_s))
        axes.plot([low, high], [row, row], color=color, lw=2)
        axes.plot([low, high], [row, row], "|", color=color, ms=10, mew=2)
        axes.plot(mean, row, "o", color=color, ms=7)
        axes.plot(p95, row, "D", mfc="white", mec=color, ms=5)
        axes.annotate(
            f"{mean:.1f} ms", (high, row), xytext=(8, 0), textcoords="offset points", va="center", fontsize=8
        )
    axes.set_yticks(
        range(len(results.timings)),
        [f"{t.detector}\n{t.machine}, {t.provider}, {t.threads} thr." for t in results.timings],
        fontsize=8,
    )
    axes.set_ylim(len(results.timings) - 0.4, -0.6)
    axes.set_xscale("log")
    axes.margins(x=0.25)
    for formatter in (axes.xaxis.set_major_formatter, axes.xaxis.set_minor_formatter):
        formatter(FuncFormatter(lambda ms, _: f"{ms:g}"))
    axes.tick_params(axis="x", which="both", labelsize=8)
    axes.set_xlabel("ms per picture, log scale: minimum | mean (dot), 95 % (diamond) | maximum", fontsize=9)
    axes.grid(visible=True, which="both", axis="x", alpha=0.3)
    return figure


def context_picture(results: Results) -> Figure:
    """AP .5 against the expected size of a person, under the pool's codec, by bitrate."""
    figure = Figure(figsize=(4.2 * max(len(results.detectors), 2), 3.6), dpi=_DPI, layout="constrained")
    grid = figure.subplots(1, max(len(results.detectors), 2), squeeze=False, sharey=True)[0]
    bitrates = results.bitrates_bps
    for axes, detector in zip(grid, results.detectors, strict=False):
        for k, bitrate in enumerate(bitrates):
            cell = results.cell(detector.id, results.codec, bitrate)
            points = [] if cell is None else [(_middle(c), c.figures.ap50) for c in cell.by_context]
            points = [(x, y) for x, y in points if y is not None]
            shade = 0.15 + 0.8 * k / max(len(bitrates) - 1, 1)
            if points:
                axes.plot(
                    *zip(*points, strict=True), "o-", ms=4, color=_shade(shade), label=bitrate_name(bitrate)
                )
        axes.set_title(f"{detector.id}, {CODEC_NAMES[results.codec]}", fontsize=11)
        axes.set_xlabel("expected size of a standing person, px", fontsize=9)
        axes.set_ylim(0.0, 1.02)
        axes.set_xlim(0.0, 130.0)
        axes.grid(visible=True, alpha=0.3)
    for axes in grid[len(results.detectors) :]:
        axes.set_visible(False)
    grid[0].set_ylabel("AP .5")
    grid[0].legend(fontsize=7, frameon=False, title="bitrate", title_fontsize=8)
    return figure


def _shade(share: float) -> tuple[float, float, float]:
    return (0.85 * (1 - share), 0.25 + 0.35 * share, 0.45 + 0.35 * share)


def _middle(context: ContextFigures) -> float:
    above = 1.5 * context.from_px if context.below_px is None else context.below_px
    return 0.5 * (float(context.from_px) + float(above))


def frames_picture(frames: Sequence[tuple[str, NDArray[np.uint8], FloatArray, FloatArray]]) -> Figure:
    """A picture under several conditions: name, (H, W, 3), true boxes and found boxes (N, 4) xyxy."""
    columns = 2
    rows = -(-len(frames) // columns)
    height, width = frames[0][1].shape[:2]
    figure = Figure(
        figsize=(6.4 * columns, 6.4 * rows * height / width + 0.5), dpi=_DPI, layout="constrained"
    )
    for k, (name, image, true, found) in enumerate(frames):
        axes = figure.add_subplot(rows, columns, k + 1)
        axes.imshow(image, interpolation="nearest")
        for boxes, color, style in ((true, "#ffffff", "--"), (found, "#ffd500", "-")):
            for x0, y0, x1, y1 in boxes:
                axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, fill=False, ec=color, ls=style, lw=1.3))
        axes.set_title(name, fontsize=10)
        axes.set_axis_off()
    return figure

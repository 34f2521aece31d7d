"""The report of an evaluation: one HTML file with everything in it, readable offline."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pipeline.evaluation.report.examples import Example
from pipeline.evaluation.report.paper_claims import missed_targets, shapes
from pipeline.evaluation.report.pictures import (
    CODEC_NAMES,
    accuracy_picture,
    bitrate_name,
    context_picture,
    frames_picture,
    lrp_picture,
    size_picture,
    time_picture,
)
from pipeline.evaluation.report.results import DetectorFile, Results
from pipeline.outputs.html import page_environment


@dataclass(frozen=True, slots=True)
class ReportFigure:
    """name: of its file. title, note: around it."""

    name: str
    title: str
    note: str
    png: bytes


def report_figures(results: Results, examples: list[Example]) -> list[ReportFigure]:
    """The paper's figures, as far as there are cells, times and pictures for them."""
    drawn = _drawn(results, examples)
    return [ReportFigure(name, title, note, _png(figure)) for name, title, note, figure in drawn]


def _drawn(results: Results, examples: list[Example]) -> Iterator[tuple[str, str, str, Figure]]:
    if results.bitrates_bps:
        yield (
            "accuracy",
            "Accuracy against bitrate",
            "One colour for each detector, one line for each codec. Shaded: 95 % intervals under "
            f"{CODEC_NAMES[results.codec]}, bootstrap over sequences. Bitrates are those asked for"
            + (f"; obtained, in kbps: {', '.join(missed)}." if (missed := missed_targets(results)) else "."),
            accuracy_picture(results),
        )
        yield (
            "sizes",
            "Accuracy by size",
            "COCO's size classes, in pixels of the encoded picture: up to 32, up to 96, above 96 square.",
            size_picture(results),
        )
        yield (
            "lrp",
            "1 - moLRP and its parts",
            "Up is better in every panel. Hollow: the optimal score threshold is the cut-off, the true "
            "optimum lies lower; the paper leaves such points out.",
            lrp_picture(results),
        )
        if any(cell.by_context for cell in results.cells):
            yield (
                "context",
                "Accuracy by the size that is expected from height, pitch and focal length",
                "What allocation can know before the flight: a standing person, 1.7 m high, 0.5 m wide, "
                "in the middle of the picture.",
                context_picture(results),
            )
    if examples:
        yield (
            "frames",
            f"The same picture at {bitrate_name(min(e.bitrate_bps for e in examples if e.bitrate_bps))}bps"
            if any(e.bitrate_bps for e in examples)
            else "A picture",
            f"White, dashed: who is there. Yellow: what {results.detectors[-1].id} finds at its threshold, "
            f"{results.detectors[-1].score_threshold:.2f}.",
            frames_picture([(_name(e), e.image, e.true_px, e.found_px) for e in examples]),
        )
    if results.timings:
        yield (
            "times",
            "Execution times",
            "From pixels to boxes, warm-up left out.",
            time_picture(results),
        )


def _name(example: Example) -> str:
    if example.codec is None or example.bitrate_bps is None:
        return "as filmed"
    return f"{CODEC_NAMES[example.codec]} at {bitrate_name(example.bitrate_bps)}bps"


def render_report(results: Results, figures: list[ReportFigure]) -> str:
    """The report's HTML; every text from outside is escaped."""
    environment = page_environment("pipeline.evaluation.report")
    environment.filters.update(
        ms=lambda s: f"{1e3 * s:.2f}",
        kbps=lambda bps: "–" if bps is None else f"{bps / 1e3:.0f}",
        figure=lambda x: "–" if x is None else f"{x:.3f}",
        complement=lambda x: "–" if x is None else f"{1.0 - x:.3f}",
    )
    mix = results.provenance.size_mix
    return environment.get_template("evaluation.html.j2").render(
        results=results,
        figures=figures,
        shapes=shapes(results) if results.bitrates_bps else (),
        verdict=verdict(results),
        mix=" / ".join(f"{100 * share:.0f}" for share in mix.values()),
        conditions=len(results.cells) // max(len(results.detectors), 1),
        provenance=_provenance(results),
    )


def verdict(results: Results) -> str:
    """One sentence: which detector is best under the pool's codec, and down to which bitrate it stays so."""
    cells = [c for c in results.cells if c.codec == results.codec] or list(results.cells)
    known = [(value, c) for c in cells if (value := c.figures.value(results.metric)) is not None]
    if not known:
        return "Nothing could be measured: there is nobody to find."
    best, cell = max(known, key=lambda pair: pair[0])
    at = "" if cell.bitrate_bps is None else f" ({results.codec}, {bitrate_name(cell.bitrate_bps)}bps)"
    sentence = f"Best: {cell.detector}, {results.metric} {best:.3f}{at}"
    own = sorted((c.bitrate_bps, v) for v, c in known if c.detector == cell.detector and c.bitrate_bps)
    kept = [bps for bps, value in own if value >= 0.95 * best]
    return sentence + (f"; 95 % of it down to {bitrate_name(min(kept))}bps." if kept else ".")


def _provenance(results: Results) -> list[tuple[str, str]]:
    p = results.provenance
    more = ", .." if len(p.sequences) > 12 else ""
    rows = [
        ("date", p.date),
        ("machine", f"{p.machine}, {p.cores} cores"),
        ("versions", ", ".join(f"{name} {version}" for name, version in p.versions.items())),
        ("evaluation file", f"{p.evaluation} (sha256 {p.evaluation_sha256[:16]})"),
        (
            "data set",
            f"sha256 {p.dataset_sha256[:16]}: {', '.join(p.sequences[:12])}{more}",
        ),
    ]
    rows += [
        (
            d.id,
            f"{d.model}, {d.precision}, sha256 {d.sha256[:16]}; threshold {d.score_threshold:.2f}"
            + _calibration(d),
        )
        for d in results.detectors
    ]
    return [
        *rows,
        ("processor time of all cells", _shares(p.seconds)),
        ("of it in this run, with all else", _shares(p.seconds_this_run)),
    ]


def _calibration(d: DetectorFile) -> str:
    if d.calibration is None or d.calibration_error is None or d.calibrated_error is None:
        return ""
    return (
        f"; expected calibration error of the scores above it {d.calibration_error:.3f}, "
        f"calibrated {d.calibrated_error:.3f}"
    )


def _shares(seconds: dict[str, float]) -> str:
    total = sum(seconds.values()) or 1.0
    largest_first = sorted(seconds.items(), key=lambda item: -item[1])
    return ", ".join(f"{part} {s:.1f} s ({s / total:.1%})" for part, s in largest_first)


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    FigureCanvasAgg(figure)
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()

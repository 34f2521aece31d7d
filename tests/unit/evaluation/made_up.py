"""Results with chosen figures, for what is made of results."""

from __future__ import annotations

import numpy as np

from pipeline.evaluation.measuring.setup_timing import SetupTiming
from pipeline.evaluation.metrics.cell import Cell, ContextFigures, Figures, Replicated
from pipeline.evaluation.report.results import DetectorFile, Provenance, Results

BITRATES = (50e3, 500e3, 1e6, 2.5e6, 20e6)
CODECS = ("h264", "vp9", "h265", "av1")


def figures(ap: float | None, people: int = 10) -> Figures:
    return Figures(
        people=people, ap=ap, ap50=ap, ap75=ap, ar1=ap, ar10=ap, ar100=ap,
        molrp=None if ap is None else 1.0 - ap, localisation=0.2, false_positive=0.1, false_negative=0.3,
        threshold=0.4, at_cutoff=False,
    )  # fmt: skip


def cell(detector, codec, bitrate, ap, small=None, medium=None, spread=0.004) -> Cell:
    rng = np.random.default_rng(1)  # the same draws in every cell, as a paired bootstrap has them
    draws = tuple(float(v) for v in np.clip(ap + spread * rng.standard_normal(50), 0, 1))
    sizes = {
        "all": figures(ap),
        "small": figures(ap if small is None else small, 4),
        "medium": figures(ap if medium is None else medium, 6),
        "large": figures(None, 0),
    }
    interval = (max(ap - 0.02, 0.0), min(ap + 0.02, 1.0))
    return Cell(
        detector=detector, codec=codec, bitrate_bps=bitrate, obtained_bps=bitrate and 1.05 * bitrate,
        largest_packet_s=bitrate and 0.4, pictures=8, by_size=sizes,
        by_context=(ContextFigures(from_px=32.0, below_px=48.0, pictures=8, figures=figures(ap)),),
        intervals={"ap": interval, "ap50": interval, "ar100": interval, "one_minus_molrp": interval},
        replicates=Replicated(ap=draws, ap50=draws, ar100=draws, molrp=tuple(1 - d for d in draws)), not_finite=0,
    )  # fmt: skip


def timing(detector: str, mean_s: float, machine: str = "workstation") -> SetupTiming:
    return SetupTiming(
        detector=detector, machine=machine, provider="cpu", threads=1, clock="wall", pictures=50,
        minimum_s=0.9 * mean_s, mean_s=mean_s, maximum_s=2 * mean_s, p95_s=1.5 * mean_s, memory_bytes=80_000_000,
        sharing={2: 1.4, 3: 2.2}, busy=0.0,
    )  # fmt: skip


def ap_like_the_paper(detector: str, codec: str, bitrate: float) -> float:
    if detector == "tiny":
        return 0.2
    lost = {"h264": 0.5, "vp9": 0.3, "h265": 0.1, "av1": 0.05}[codec]
    return 0.6 - (lost * (1.0 if bitrate < 1e5 else 0.3) if bitrate < 1e6 else 0.0)


def results(ap=ap_like_the_paper, detectors=("tiny", "large"), simulated=True, small=1.0, **more) -> Results:
    cells = [cell(d, None, None, ap(d, "h264", 20e6)) for d in detectors]
    for d in detectors:
        for codec in CODECS:
            for bitrate in BITRATES:
                value = ap(d, codec, bitrate)
                lost = max(ap(d, codec, 20e6) - value, 0.0)
                cells.append(
                    cell(d, codec, bitrate, value, small=max(value - small * lost, 0.0), medium=value)
                )
    return Results(
        name="made-up", metric="ap50", codec="h264", score_cutoff=0.05,
        detectors=tuple(
            DetectorFile(id=d, model=f"/models/{d}.onnx", card=None, sha256=str(k) * 64, precision="as_exported",
                         score_threshold=0.4)
            for k, d in enumerate(detectors)
        ),
        cells=tuple(cells),
        timings=tuple(timing(d, 0.004 * 10**k) for k, d in enumerate(detectors)),
        provenance=Provenance(
            evaluation="e.yaml", evaluation_sha256="a" * 64, dataset_sha256="b" * 64, sequences=("s-1", "s-2"),
            pictures=8, people=10, ignored=1, size_mix={"small": 0.16, "medium": 0.79, "large": 0.05},
            simulated=simulated, machine="a <b>machine</b>", cores=2, versions={"python": "3"}, date="2026-01-01",
            faults=(), missing_codecs=(), seconds={"encode": 5.0, "detect": 5.0}, seconds_this_run={},
        ),
    ).model_copy(update=more)  # fmt: skip

"""Where, when, with what and on what an evaluation was made."""

from __future__ import annotations

import datetime
import os
import platform
from importlib.metadata import version
from pathlib import Path

import av
import onnxruntime

from pipeline.evaluation.datasets.dataset import sha256_of_file
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.evaluation.measuring.grid_results import GridResults
from pipeline.evaluation.metrics.matching import AREAS
from pipeline.evaluation.report.results import Provenance


def provenance(path: Path, found: GridResults, faults: FaultLog, spent: dict[str, float]) -> Provenance:
    """The record of an evaluation. spent: seconds of this run, by what they were spent on."""
    dataset, truth = found.dataset, found.sample.truth
    area = truth.area[~truth.crowd]
    inside = {
        "small": area <= AREAS["small"][1],
        "medium": (area > AREAS["medium"][0]) & (area <= AREAS["medium"][1]),
        "large": area > AREAS["large"][0],
    }
    return Provenance(
        evaluation=str(path),
        evaluation_sha256=sha256_of_file(path),
        dataset_sha256=dataset.sha256,
        sequences=tuple(q.name for q in dataset.sequences),
        pictures=found.sample.images,
        people=len(area),
        ignored=int(truth.crowd.sum()),
        size_mix={
            size: round(float(share.mean()) if len(area) else 0.0, 4) for size, share in inside.items()
        },
        simulated=dataset.simulated,
        machine=machine_name(),
        cores=os.cpu_count() or 1,
        versions=_versions(),
        date=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        faults=tuple(faults.lines()),
        missing_codecs=found.grid.missing_codecs,
        seconds={part: round(s, 3) for part, s in found.seconds().items()},
        seconds_this_run={part: round(s, 3) for part, s in spent.items()},
    )


def _versions() -> dict[str, str]:
    packages = {name: version(name) for name in ("searchlight", "numpy", "hotcoco")}
    ffmpeg = ".".join(map(str, av.library_versions["libavcodec"]))
    own = {"python": platform.python_version(), "onnxruntime": onnxruntime.__version__}
    return own | {"av": av.__version__, "libavcodec": ffmpeg} | packages


def machine_name() -> str:
    """The processor's name, as the system tells it."""
    cpuinfo = Path("/proc/cpuinfo")
    for line in cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.is_file() else ():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()

"""A pool with one detector, from labelled pictures or like another one."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.config.base import FORMAT_VERSION
from pipeline.config.evaluation import Setup
from pipeline.config.pool import PoolDetector, load_pool
from pipeline.detection import Reading
from pipeline.detection.model_file import sha256_of
from pipeline.evaluation.labelled import LabelledResult
from pipeline.evaluation.measuring.setup_timing import SetupTiming, time_setup
from pipeline.evaluation.pool.pool_file import AS_THEY_ARE_BPS, assumed_as_they_are, sharing_rows, time_row
from pipeline.storage.whole_or_nothing import replacing

_PICTURES, _WARM_UP = 20, 3
_MEMORY_MARGIN = 1.25


@dataclass(frozen=True)
class NewDetector:
    """id: its name in the pool. setup: the machine that it is timed on."""

    id: str
    model: Path
    reading: Reading
    setup: Setup


def timed(
    new: NewDetector,
    images: list[NDArray[np.uint8]],
    progress: Callable[[str], None],
    sharing: tuple[int, ...] = (2,),
) -> SetupTiming:
    """Its times on this machine. images: (H, W, 3) each, of the size that will be looked at."""
    return time_setup(
        new.id,
        new.model,
        new.setup,
        images,
        pictures=_PICTURES,
        warm_up=_WARM_UP,
        sharing=sharing,
        score_cutoff=0.3,
        progress=progress,
        reading=new.reading,
    )


def measured_row(new: NewDetector, result: LabelledResult, timing: SetupTiming, out: Path) -> dict[str, Any]:
    """The row of a detector that was measured on labelled pictures."""

    def at() -> dict[str, Any]:  # a new one each time, or YAML writes references
        return {"bitrate": {"mbps": AS_THEY_ARE_BPS / 1e6}}

    accuracy = round(result.by_size["all"].ap50 or 0.0, 4)
    sizes = [
        at() | {"size": size, "accuracy": round(f.ap50, 4)}
        for size, f in result.by_size.items()
        if size != "all" and f.ap50 is not None
    ]
    row = _common(new, timing, out) | {
        "score_threshold": result.threshold,
        "accuracy": [at() | {"accuracy": accuracy}],
        "accuracy_by_size": sizes,
        "assumed": assumed_as_they_are(result.pictures, result.people),
    }
    if result.calibration is not None:
        row["calibration"] = result.calibration.model_dump()
    return row


def assumed_row(new: NewDetector, like: PoolDetector, timing: SetupTiming, out: Path) -> dict[str, Any]:
    """The row of a detector of which nothing but its times is known."""
    copied = {"score_threshold", "accuracy", "accuracy_by_size", "accuracy_by_codec", "accuracy_by_context"}
    known = like.model_dump(mode="json", include=copied)
    rows = {
        name: [_with_units(row) for row in value] if isinstance(value, list) else value
        for name, value in known.items()
        if value not in ([], None)
    }
    said = f"accuracy and threshold as those of {like.id}; never measured"
    return _common(new, timing, out) | rows | {"assumed": said}


def _with_units(row: dict[str, Any]) -> dict[str, Any]:
    units = {"bitrate": ("kbps", 1e-3), "obtained": ("kbps", 1e-3), "largest_packet": ("milliseconds", 1e3)}
    return {
        name: {units[name][0]: value * units[name][1]} if name in units else value
        for name, value in row.items()
        if value is not None
    }


def _common(new: NewDetector, timing: SetupTiming, out: Path) -> dict[str, Any]:
    reading = new.reading
    layout = reading.layout
    described = (
        layout if isinstance(layout, str | None) else layout.model_dump(mode="json", exclude_none=True)
    )
    tiling = reading.tiling
    tiles = None
    if tiling is not None:
        tiles = {
            "size": [tiling.width, tiling.height],
            "overlap": tiling.overlap,
            "whole": tiling.whole,
        }
    row = {
        "id": new.id,
        "model": os.path.relpath(new.model, out.parent),
        "sha256": sha256_of(new.model),
        "layout": described,
        "names": list(reading.names) if isinstance(reading.names, tuple) else reading.names,
        "classes": {layer: list(names) for layer, names in reading.classes.items()} or None,
        "input_size": None if reading.input_size is None else list(reading.input_size),
        "tiles": tiles,
        "memory": {"megabytes": max(1, math.ceil(timing.memory_bytes * _MEMORY_MARGIN / 1e6))},
        "times": [time_row(timing)],
        "sharing": sharing_rows([timing]),
    }
    return {name: value for name, value in row.items() if value is not None}


def write_row(out: Path, row: dict[str, Any], provenance: dict[str, Any]) -> None:
    """A pool of this one detector, read back. Raises InputError if it could not be used."""
    document = {
        "version": FORMAT_VERSION,
        "provenance": provenance | {"date": datetime.now(UTC).isoformat(timespec="seconds")},
        "assumed": [f"{row['id']}: {row['assumed']}"] if row.get("assumed") else [],
        "detectors": [row],
    }
    with replacing(out) as temporary:
        temporary.write_text(yaml.safe_dump(document, sort_keys=False, width=110), encoding="utf-8")
        load_pool(temporary)

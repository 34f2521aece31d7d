"""This machine as an inventory, and the shipped detectors as a pool, their times measured here."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.config.base import FORMAT_VERSION
from pipeline.config.evaluation import Setup
from pipeline.config.pool import load_pool
from pipeline.config.shipped import shipped
from pipeline.evaluation.measuring.setup_timing import time_setup
from pipeline.evaluation.pool.pool_file import time_row
from pipeline.storage.whole_or_nothing import replacing

MACHINE_TYPE = "this-machine"
_PICTURES, _WARM_UP = 20, 3
#: left to the system and to the other actors
_MEMORY_SHARE = 0.5


def inventory_document(site: str) -> dict[str, Any]:
    """One site with this machine; every stream is filmed there, so that no radio link is in the way."""
    memory_bytes = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") * _MEMORY_SHARE
    machine = {
        "id": "this-machine",
        "type": MACHINE_TYPE,
        "memory": {"gigabytes": round(memory_bytes / 1e9, 1)},
    }
    return {
        "version": FORMAT_VERSION,
        "sites": [{"id": site, "machines": [machine]}],
        "assumed": ["every video is at hand on this machine: no radio link", "half of its memory is free"],
    }


def write_measured_pool(
    path: Path, image: NDArray[np.uint8], progress: Callable[[str, int, int], None]
) -> None:
    """The shipped detectors with their times on this machine. image: (H, W, 3), of the size to be looked at."""
    source = shipped("pools", "simulated.yaml")
    document = yaml.safe_load(source.read_text(encoding="utf-8"))
    setup = Setup(machine=MACHINE_TYPE, provider="cpu", threads=1)
    detectors = load_pool(source).detectors
    for done, (row, detector) in enumerate(zip(document["detectors"], detectors, strict=True)):
        progress("measuring detectors", done, len(detectors))
        model = detector.require_model(source).resolve()
        timing = time_setup(
            detector.id,
            model,
            setup,
            [image],
            pictures=_PICTURES,
            warm_up=_WARM_UP,
            sharing=(),  # the mission that init writes does not plan with it
            score_cutoff=detector.score_threshold,
            progress=lambda _: None,
        )
        row |= {"model": str(model), "times": [time_row(timing)]}
        row.pop("card", None)
        row.pop("sharing", None)  # of another machine
    progress("measuring detectors", len(detectors), len(detectors))
    document["provenance"]["times"] = (
        f"measured on this machine by searchlight init, {_PICTURES} pictures each"
    )
    document["version"] = FORMAT_VERSION
    with replacing(path) as temporary:
        temporary.write_text(yaml.safe_dump(document, sort_keys=False, width=110), encoding="utf-8")
        load_pool(temporary)

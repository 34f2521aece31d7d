"""Detectors that have seen simulated people only, and videos that are no simulation's."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from pipeline.detection import Detector
from pipeline.ingest.finding import Finding
from pipeline.mission.near_files import Near, here

#: what ``searchlight train`` writes into the ONNX file
TRAINED_ON, SIMULATED = "trained_on", "simulated scenes"


def knows_simulation_only(detector: Detector) -> bool:
    """Whether the file itself says that it was trained on simulated scenes."""
    found = detector.recognised
    return found is not None and found.facts.metadata.get(TRAINED_ON) == SIMULATED


def simulated_only(
    detectors: Sequence[str], videos: Sequence[tuple[str, Path]], near: Near = here
) -> list[Finding]:
    """One warning if such detectors (their ids) are to look at a video that ``simulate`` did not write.

    videos: each with the site that it is at.
    """
    real = [video for site, video in videos if detectors and not near(site, is_simulated, video)]
    if not real:
        return []
    names = f"detector{'s' if len(detectors) > 1 else ''} {', '.join(detectors)}"
    found = f"trained on simulated scenes only, and {real[0].name} is not one of simulate's videos"
    evidence = "in real pictures they miss most people, and some take things for people (docs/detectors.md)"
    mend = "a pool with detectors trained on real pictures: docs/detectors.md, searchlight detector add"
    return [Finding("warning", "simulated_detector", names, found, evidence, mend)]


def is_simulated(video: Path) -> bool:
    """Whether ``simulate`` wrote a video: its truth lies beside it and names it."""
    truth = video.parent / "truth" / f"boxes-{video.stem}.json"
    try:
        images = json.loads(truth.read_bytes())["images"]
        return bool(images) and str(images[0]["file_name"]).startswith(f"{video.name}#")
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return False

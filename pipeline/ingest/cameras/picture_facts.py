"""What telemetry and pictures say of the camera that took them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.geo.camera import Camera
from pipeline.ingest.cameras.choice import PictureFacts
from pipeline.ingest.track import Track
from pipeline.ingest.video.metadata import camera_names


def picture_facts(
    where: str,
    size: tuple[int, int],
    videos: Sequence[Path],
    track: Track | None,
    calibration: Camera | None = None,
) -> PictureFacts:
    """where: what an error names. size: of the pictures, pixels. videos: files, of which the first tells a name.

    calibration: in the metadata of stills.
    """
    names = (track.camera_name,) if track is not None and track.camera_name else ()
    of_video = camera_names(videos[0]) if videos else ()
    focal_mm = None if track is None else track.focal_length_35mm
    known = focal_mm is not None and bool(np.isfinite(focal_mm).any())
    widest_mm = float(np.nanmin(focal_mm)) if known and focal_mm is not None else 0.0
    return PictureFacts(*size, where, (*names, *of_video), calibration, widest_mm)

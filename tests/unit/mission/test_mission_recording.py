"""What was chosen for a stream reaches its trajectory."""

import math

import numpy as np
import pytest

from pipeline.config.telemetry import Telemetry
from pipeline.config.uncertainty import Uncertainty
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.cameras.choice import ChosenCamera
from pipeline.ingest.clock import Alignment
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory_of import Ground
from pipeline.mission.recording import Recording

ONE = np.ones(3)


class FakeStream:
    telemetry = Telemetry.model_validate({"file": "drone.srt", "height_datum": "ellipsoid"})


@pytest.mark.parametrize(("reference_mm", "scale"), [(None, 1.0), (24.0, 2.0), (96.0, 0.5)])
def test_the_focal_length_counts_from_the_one_that_the_camera_belongs_to(
    reference_mm: float | None, scale: float
) -> None:
    track = Track(0, np.arange(3.0), ONE, ONE, ONE, ONE, ONE, -ONE, ONE, focal_length_35mm=48.0 * ONE)
    chosen = ChosenCamera(Camera(64, 48, 50.0, 50.0, 32.0, 24.0), reference_mm)
    recording = Recording(FakeStream(), None, track, None, chosen, Alignment(1.5))  # type: ignore[arg-type]
    ground = Ground("ellipsoid", lambda east, north: math.nan)
    trajectory = recording.trajectory(LocalFrame(1.0, 1.0), ground, Uncertainty())
    assert trajectory.focal_scale.tolist() == [scale] * 3
    assert trajectory.times_s.tolist() == [1.5, 2.5, 3.5]

"""What is written coarsely is not known finely, and what is written finely stays as it was."""

import math

import numpy as np
import pytest

from pipeline.config.telemetry import Telemetry
from pipeline.config.uncertainty import Uncertainty
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.finding import Finding
from pipeline.ingest.resolution import with_resolution
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory import Trajectory
from pipeline.ingest.trajectory_of import Ground, trajectory_of

RNG = np.random.default_rng(7)
LATITUDE, LONGITUDE = RNG.uniform(58.0, 59.0, 40), RNG.uniform(15.0, 16.0, 40)
HEIGHT = 120.0 + np.cumsum(RNG.uniform(0.0, 0.3, 40))


def resolved(
    decimals: int = 9, height_decimals: int = 3, stated_m: float = math.nan, **uncertainty: object
) -> tuple[Trajectory, list[Finding]]:
    zero = np.zeros(40)
    track = Track(
        0,
        np.arange(40.0),
        np.round(LATITUDE, decimals),
        np.round(LONGITUDE, decimals),
        np.round(HEIGHT, height_decimals),
        np.round(HEIGHT - 100.0, height_decimals),
        zero,
        zero,
        zero,
        horizontal_sd_m=np.full(40, stated_m),
    )
    telemetry = Telemetry.model_validate({"file": "drone.srt"})
    ground = Ground("ellipsoid", lambda east, north: 0.0)
    believed = Uncertainty.model_validate(uncertainty)
    trajectory = trajectory_of(track, telemetry, LocalFrame(58.4, 15.57), ground, uncertainty=believed)
    return with_resolution(trajectory, track, telemetry)


def test_what_is_written_finely_states_nothing() -> None:
    trajectory, findings = resolved()
    assert np.isnan(trajectory.sds).all()
    assert findings == []


@pytest.mark.parametrize(("decimals", "step_m"), [(4, 11.132), (5, 1.1132), (3, 111.32)])
def test_a_position_is_as_sure_as_its_decimals(decimals: int, step_m: float) -> None:
    trajectory, findings = resolved(decimals, position_bias={"meters": 0.1})
    np.testing.assert_allclose(trajectory.sds[:, 0], math.hypot(0.1, step_m / math.sqrt(12.0)))
    assert np.isnan(trajectory.sds[:, 1:]).all()
    assert findings[0].cause == "resolution"
    assert (findings[0].severity == "warning") == ("not told apart" in findings[0].found) == (decimals <= 4)


def test_a_finer_position_than_the_mission_believes_changes_nothing() -> None:
    trajectory, findings = resolved(5, position_bias={"meters": 1.3})
    assert np.isnan(trajectory.sds).all()
    assert findings == []


def test_a_stated_deviation_is_widened_too() -> None:
    trajectory, _ = resolved(4, stated_m=3.0)
    np.testing.assert_allclose(trajectory.sds[:, 0], math.hypot(3.0, 11.132 / math.sqrt(12.0)))


def test_whole_metres_of_height_are_half_known() -> None:
    trajectory, findings = resolved(height_decimals=0, height_bias={"meters": 0.03})
    np.testing.assert_allclose(trajectory.sds[:, 1], math.hypot(0.03, 1.0 / math.sqrt(12.0)))
    assert "heights in steps of 1 m" in findings[0].found


def test_the_round_height_of_a_hover_does_not_tell_how_heights_are_written() -> None:
    trajectory, findings = resolved(height_decimals=-2, height_bias={"meters": 0.03})
    assert np.isnan(trajectory.sds).all()
    assert findings == []

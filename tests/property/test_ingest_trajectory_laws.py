"""Laws of interpolation: exact at the samples, between them never outside of them."""

import math
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.config.telemetry import Telemetry
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory_of import Ground, trajectory_of

FRAME = LocalFrame(59.0, 15.0)
TELEMETRY = Telemetry(file=Path("drone.srt"))
GROUND = Ground("ellipsoid", lambda east, north: math.nan)
samples = st.lists(
    st.tuples(
        st.floats(0.01, 2.0),
        st.floats(-0.01, 0.01),
        st.floats(-0.01, 0.01),
        st.floats(0.0, 500.0),
        st.floats(-7.0, 7.0),
    ),
    min_size=2,
    max_size=12,
)


def track_of(rows: list[tuple[float, float, float, float, float]]) -> Track:
    steps, north, east, heights, yaw = (np.array(column) for column in zip(*rows, strict=True))
    level = np.zeros(len(rows))
    return Track(0, np.cumsum(steps), 59.0 + north, 15.0 + east, heights, heights, yaw, level - 0.8, level)


@given(samples, st.data())
def test_at_a_sample_the_pose_is_the_samples(
    rows: list[tuple[float, float, float, float, float]], data: st.DataObject
) -> None:
    track = track_of(rows)
    i = data.draw(st.integers(0, len(rows) - 1))
    pose = trajectory_of(track, TELEMETRY, FRAME, GROUND).pose(float(track.times_s[i]))
    assert pose is not None
    east, north = FRAME.enu_from_wgs84(track.latitude_deg[i], track.longitude_deg[i])
    np.testing.assert_allclose(pose.position_enu, [east, north, track.absolute_height_m[i]], atol=1e-6)
    np.testing.assert_allclose(pose.enu_from_camera, enu_from_camera(track.yaw_rad[i], -0.8, 0.0), atol=1e-9)


@given(samples, st.data(), st.floats(0.0, 1.0))
def test_between_samples_the_pose_lies_between_theirs(
    rows: list[tuple[float, float, float, float, float]], data: st.DataObject, share: float
) -> None:
    track = track_of(rows)
    i = data.draw(st.integers(0, len(rows) - 2))
    time_s = float(track.times_s[i] + share * (track.times_s[i + 1] - track.times_s[i]))
    pose = trajectory_of(track, TELEMETRY, FRAME, GROUND).pose(time_s)
    assert pose is not None
    heights = sorted(track.absolute_height_m[i : i + 2])
    assert heights[0] - 1e-6 <= pose.position_enu[2] <= heights[1] + 1e-6
    turn = abs(math.remainder(track.yaw_rad[i + 1] - track.yaw_rad[i], 2 * math.pi))
    forward = pose.enu_from_camera[:2, 2] / np.linalg.norm(pose.enu_from_camera[:2, 2])
    yaw = math.atan2(forward[0], forward[1])
    for j in (i, i + 1):
        assert abs(math.remainder(yaw - track.yaw_rad[j], 2 * math.pi)) <= turn + 1e-6

"""The ways of the drones that a run directory shows go from the first picture to the last."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.mission.run_directory import _track


def flown(start_s: float, end_s: float, known_from_s: float = 0.0) -> SimpleNamespace:
    """A mission of two streams; the second goes east at 10 m/s, its pose known from a time on."""

    def pose(time_s: float) -> SimpleNamespace | None:
        place = np.array([10.0 * time_s, 3.0, 40.0])
        return SimpleNamespace(position_enu=place) if time_s >= known_from_s else None

    video = SimpleNamespace(start_s=start_s, frame_rate=25.0)
    trajectory = SimpleNamespace(pose=pose)
    other = SimpleNamespace(stream="other", trajectory=None, video=None, end_s=0.0)
    return SimpleNamespace(
        streams=[other, SimpleNamespace(stream="v", video=video, trajectory=trajectory, end_s=end_s)]
    )


@pytest.mark.parametrize(("start_s", "end_s"), [(0.0, 60.0), (12.3, 14.0), (0.04, 601.7)])
def test_a_way_is_whole_and_leaves_out_no_half_second(start_s: float, end_s: float) -> None:
    way = _track(flown(start_s, end_s), "v")  # type: ignore[arg-type]
    assert way[0] == pytest.approx([10.0 * start_s, 3.0, 40.0])
    assert 10.0 * (end_s - 0.6) <= way[-1, 0] <= 10.0 * end_s
    assert np.diff(way[:, 0]).max() == pytest.approx(5.0)


def test_only_what_has_no_pose_is_missing() -> None:
    way = _track(flown(0.0, 20.0, known_from_s=7.0), "v")  # type: ignore[arg-type]
    assert (way[0, 0], way[-1, 0]) == (pytest.approx(70.0), pytest.approx(195.0))
    assert len(way) == 26


def test_a_way_without_any_pose_has_no_points() -> None:
    assert _track(flown(0.0, 20.0, known_from_s=99.0), "v").shape == (0, 3)  # type: ignore[arg-type]

"""Contours lie where the ground has their height, and flat ground has none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.geo.frame import LocalFrame
from pipeline.view.contours import contours
from pipeline.view.ground import Ground

FRAME = LocalFrame(58.4, 15.6)


def hill(rows: int, columns: int, cell_m: float, height_m: float, base_m: float = 0.0) -> Ground:
    """A cone in the middle."""
    east = (np.arange(columns) + 0.5 - columns / 2.0) * cell_m
    north = (np.arange(rows) + 0.5 - rows / 2.0) * cell_m
    reach = min(rows, columns) * cell_m / 2.0
    heights = base_m + height_m * np.clip(1.0 - np.hypot(*np.meshgrid(east, north)) / reach, 0.0, 1.0)
    return Ground(FRAME, east[0] - cell_m / 2, north[0] - cell_m / 2, cell_m, heights.astype(np.float32))


@settings(max_examples=30, deadline=None)
@given(
    st.integers(40, 400),
    st.integers(40, 400),
    st.floats(0.25, 5.0),
    st.floats(5.0, 900.0),
    st.floats(-400, 4e3),
)
def test_a_contour_lies_where_the_ground_has_its_height(
    rows: int, columns: int, cell_m: float, height_m: float, base_m: float
) -> None:
    ground = hill(rows, columns, cell_m, height_m, base_m)
    found = contours(ground)
    assert 1 <= len(found) <= 21
    reach = min(rows, columns) * cell_m / 2.0
    slope = height_m / reach
    # means over squares, and the corner of a square
    off_m = 2.0 * slope * cell_m * max(1, -(-max(rows, columns) // 150)) + 1e-3 * height_m + 0.1 * slope
    for contour in found:
        for line in contour["lines"]:
            away = np.hypot(*np.array(line).T)
            heights = base_m + height_m * np.clip(1.0 - away / reach, 0.0, 1.0)
            assert np.abs(heights - contour["height_m"]).max() < off_m


def test_steps_are_round_and_every_fifth_is_stronger() -> None:
    found = contours(hill(200, 200, 1.0, 95.0, base_m=103.0))
    heights = [c["height_m"] for c in found]
    assert set(np.diff(heights)) == {5.0}
    assert [c["height_m"] for c in found if c["index"]] == [h for h in heights if h % 25.0 == 0.0]


@pytest.mark.parametrize("height_m", [0.0, 0.4])
def test_flat_ground_has_none(height_m: float) -> None:
    assert contours(hill(100, 100, 1.0, height_m)) == []


def test_ground_that_is_not_known_has_none_and_the_rest_keeps_its_own() -> None:
    ground = hill(100, 100, 1.0, 50.0)
    heights = ground.heights_m.copy()
    heights[:, :50] = np.nan
    found = contours(Ground(FRAME, ground.east_m, ground.north_m, 1.0, heights))
    assert found
    assert all(point[0] >= 0.0 for c in found for line in c["lines"] for point in line)
    nothing = np.full((100, 100), np.nan, dtype=np.float32)
    assert contours(Ground(FRAME, 0.0, 0.0, 1.0, nothing)) == []

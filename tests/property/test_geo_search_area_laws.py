"""Whatever a team draws is measured as its cells are counted, or refused in one line."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.search_area import load_search_area
from pipeline.geo.terrain import Terrain
from pipeline.second_look.cells import cells_inside

FRAME = LocalFrame(47.0, 8.0)
TERRAIN = Terrain(FRAME, -60.0, -60.0, 0.5, np.zeros((240, 240), np.float32))
METERS = st.integers(-50, 50)
RINGS = st.lists(st.tuples(METERS, METERS), min_size=3, max_size=9)


def loaded(document: object, frame: LocalFrame = FRAME):  # type: ignore[no-untyped-def]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.geojson"
        path.write_text(json.dumps(document), encoding="utf-8")
        return load_search_area(path, frame)


def degrees(ring: list[tuple[int, int]]) -> list[list[float]]:
    points = np.array([*ring, ring[0]], dtype=np.float64)
    latitude, longitude = FRAME.wgs84_from_enu(points[:, 0], points[:, 1])
    return np.stack([longitude, latitude], axis=1).tolist()  # type: ignore[no-any-return]


@settings(max_examples=60, deadline=None)
@given(st.lists(RINGS, min_size=1, max_size=3))
def test_the_area_of_any_polygons_is_that_of_the_cells_whose_middle_is_inside(
    rings: list[list[tuple[int, int]]],
) -> None:
    try:
        area = loaded({"type": "MultiPolygon", "coordinates": [[degrees(ring)] for ring in rings]})
    except InputError as error:
        refused = str(error)
    else:
        refused = ""
    if refused:
        assert "enclose no area" in refused
        return
    around_m = sum(
        float(np.linalg.norm(np.diff(np.vstack([ring, ring[:1]]), axis=0), axis=1).sum())
        for rings in area.polygons
        for ring in rings
    )
    counted_m2 = cells_inside(area, TERRAIN).sum() * 0.25
    # a cell that a border runs through counts or not
    assert abs(counted_m2 - area.area_m2) <= 0.5 * around_m + 2.0


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-360.0, 360.0), st.floats(-90.0, 90.0)), min_size=3, max_size=6),
    st.sampled_from([(47.0, 8.0), (0.0, 180.0), (89.9, 0.0), (-89.9, 45.0)]),
)
def test_polygons_anywhere_on_earth_are_finite_or_refused(
    ring: list[tuple[float, float]], origin: tuple[float, float]
) -> None:
    try:
        area = loaded({"type": "Polygon", "coordinates": [[list(p) for p in ring]]}, LocalFrame(*origin))
    except InputError:
        return
    assert np.isfinite(area.area_m2)
    assert np.isfinite(area.bounds_m).all()


def test_a_polygon_a_quarter_of_the_earth_away_is_refused_for_that() -> None:
    with pytest.raises(InputError, match="away from the flight"):
        loaded({"type": "Polygon", "coordinates": [[[8, 47], [98, 0], [8, 48]]]})

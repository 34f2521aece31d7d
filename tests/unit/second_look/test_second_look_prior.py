"""A prior keeps its probability on the map, and what a search leaves of it is what Bayes' rule says."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from rasterio.transform import from_origin

from pipeline.config.prior import Prior
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.terrain import Terrain
from pipeline.mission.checks import prior_is_on_terrain
from pipeline.second_look.areas import Layers, second_look_areas
from pipeline.second_look.prior import area_probability, remaining

FRAME = LocalFrame(47.0, 8.0)
#: 100 m x 80 m
TERRAIN = Terrain(FRAME, -50.0, -40.0, 0.5, np.zeros((160, 200), dtype=np.float32))
EAST = TERRAIN.east_m + (np.arange(200) + 0.5) * 0.5
NORTH = TERRAIN.north_m + (np.arange(160) + 0.5) * 0.5


def here(*rings: tuple[float, float]) -> Prior:
    point = {"latitude": {"degrees": 47.0}, "longitude": {"degrees": 8.0}}
    listed = [{"within": {"meters": within}, "probability": p} for within, p in rings]
    return Prior.model_validate({"last_known_point": point, "rings": listed})


def polygons(path: Path, *squares: tuple[float, float, float, object]) -> Prior:
    """Squares of a south-west corner, a side, and a weight."""
    features = []
    for east, north, side, weight in squares:
        ring = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * side + (east, north)
        latitude, longitude = FRAME.wgs84_from_enu(ring[:, 0], ring[:, 1])
        shape = {"type": "Polygon", "coordinates": [np.stack([longitude, latitude], axis=1).tolist()]}
        features.append({"type": "Feature", "geometry": shape, "properties": {"weight": weight}})
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return Prior(file=path)


def raster(path: Path, weights: np.ndarray, crs: object, transform: rasterio.Affine, **more: object) -> Prior:
    rows, columns = weights.shape
    with rasterio.open(
        path, "w", driver="GTiff", width=columns, height=rows, count=1, dtype=weights.dtype, crs=crs,
        transform=transform, **more,
    ) as target:  # fmt: skip
        target.write(weights, 1)
    return Prior(file=path)


def test_within_each_ring_there_is_what_was_said() -> None:
    poa = area_probability(here((10.0, 0.25), (20.0, 0.5), (35.0, 0.8)), TERRAIN)
    distance = np.hypot(EAST[None, :], NORTH[:, None])
    for within_m, probability in ((10.0, 0.25), (20.0, 0.5), (35.0, 0.8), (1e9, 0.8)):
        assert poa[distance < within_m].sum() == pytest.approx(probability, abs=0.005)


def test_what_lies_beyond_the_map_is_on_no_cell() -> None:
    poa = area_probability(here((1000.0, 1.0)), TERRAIN)
    assert poa.sum() == pytest.approx(100.0 * 80.0 / (math.pi * 1000.0**2), rel=0.01)


def test_polygons_hold_their_share_of_the_weights_also_where_they_overlap_or_leave_the_map(
    tmp_path: Path,
) -> None:
    prior = polygons(
        tmp_path / "a.geojson", (-40, -30, 20, 3.0), (-30, -20, 20, 1), (40, -10, 20, 4), (30, 20, 5, 0)
    )
    poa = area_probability(prior, TERRAIN)
    assert poa.sum() == pytest.approx(4.0 / 8.0 + 0.5 * 4.0 / 8.0, rel=0.01)
    east = poa[:, EAST > 40]
    assert east.sum() == pytest.approx(0.5 * 4.0 / 8.0, rel=0.01)
    both = (EAST[None, :] > -30) & (EAST[None, :] < -20) & (NORTH[:, None] > -20) & (NORTH[:, None] < -10)
    assert poa[both].mean() / 0.25 == pytest.approx((3.0 / 8.0 + 1.0 / 8.0) / 400.0, rel=0.02)


@pytest.mark.parametrize("projection", ["map", "utm", "wgs84"])
def test_a_raster_keeps_its_mass_in_any_projection_and_its_hottest_place(
    tmp_path: Path, projection: str
) -> None:
    weights = np.full((12, 16), 0.5, dtype=np.float32)
    weights[2, 11] = 40.0
    latitude, longitude = FRAME.wgs84_from_enu(np.array([-32.0, 32.0]), np.array([-24.0, 24.0]))
    if projection == "map":
        crs, transform = FRAME.crs.to_wkt(), from_origin(-32.0, 24.0, 4.0, 4.0)
    elif projection == "wgs84":
        steps = np.diff(longitude)[0] / 16, np.diff(latitude)[0] / 12
        crs, transform = "EPSG:4326", from_origin(longitude[0], latitude[1], *steps)
    else:
        east, north = rasterio.warp.transform("EPSG:4326", "EPSG:32632", longitude[:1], latitude[1:])
        crs, transform = "EPSG:32632", from_origin(east[0], north[0], 4.0, 4.0)
    poa = area_probability(raster(tmp_path / "poa.tif", weights, crs, transform), TERRAIN)
    assert poa.sum() == pytest.approx(1.0, abs=0.03)
    row, column = np.unravel_index(poa.argmax(), poa.shape)
    assert abs(EAST[column] - (-32.0 + 11.5 * 4.0)) < 4.0
    assert abs(NORTH[row] - (24.0 - 2.5 * 4.0)) < 4.0


def test_where_a_raster_has_no_data_nobody_is_and_inside_scales_all(tmp_path: Path) -> None:
    weights = np.ones((4, 4), dtype=np.float32)
    weights[:, :2], weights[0, 2] = -9999.0, np.nan
    prior = raster(
        tmp_path / "p.tif", weights, FRAME.crs.to_wkt(), from_origin(-8.0, 8.0, 4.0, 4.0), nodata=-9999.0
    )
    poa = area_probability(prior.model_copy(update={"inside": 0.7}), TERRAIN)
    assert poa.sum() == pytest.approx(0.7, abs=1e-6)
    assert poa[:, EAST < 0].sum() == 0.0


@given(
    st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 0.99)), min_size=1, max_size=6),
    st.floats(0.0, 1.0),
)
def test_what_is_left_is_the_conditional_probability_of_each_place_given_that_nobody_was_found(
    cells: list[tuple[float, float]], elsewhere: float
) -> None:
    shares = np.array([share for share, _ in cells])
    total = shares.sum() + elsewhere
    if total == 0.0:
        return
    poa, pod = shares / total, np.array([p for _, p in cells])
    left = remaining(poa[None], pod[None])
    not_found = [a * (1.0 - p) for a, p in zip(poa, pod, strict=True)]  # joint with: is there
    chance = sum(not_found) + elsewhere / total
    assert left.left[0] == pytest.approx([one / chance for one in not_found], abs=1e-9)
    assert left.left.sum() + (1.0 - left.on_map) / (1.0 - left.pos) == pytest.approx(1.0)
    assert left.pos == pytest.approx(1.0 - chance, abs=1e-9)


def test_a_person_who_was_certain_to_be_found_and_was_not_is_nowhere() -> None:
    left = remaining(np.array([[1.0]]), np.array([[1.0]]))
    assert (left.pos, left.left.sum()) == (1.0, 0.0)


def test_the_second_look_goes_first_where_the_prior_says(params) -> None:
    def layer(value: float, kind: type) -> np.ndarray:
        return np.full((60, 80), value, dtype=kind)

    layers = Layers(
        layer(0.1, np.float32), layer(80, np.int32), layer(2, np.int32), layer(80, np.float32), layer(0.9, np.float32)
    )  # fmt: skip
    layers.pod[10:30, 10:30], layers.pod[10:20, 50:60] = 0.2, 0.2  # the first is four times as large
    everywhere = np.ones((60, 80), dtype=bool)
    poa = np.zeros((60, 80))
    poa[10:20, 50:60] = 0.9 / 100.0
    plain = second_look_areas(layers, everywhere, (0.0, 0.0), 0.5, params)
    led = second_look_areas(layers, everywhere, (0.0, 0.0), 0.5, params, poa)
    assert [a.area_m2 for a in plain] == [100.0, 25.0]
    assert [a.area_m2 for a in led] == [25.0, 100.0]
    assert led[0].worth == pytest.approx(0.9 * 0.8, rel=1e-5)
    assert led[1].worth == 0.0


def _bad_raster(path: Path, value: float, crs: object = None) -> Prior:
    weights = np.full((4, 4), value, dtype=np.float32)
    weights[0, 0] = abs(value) if value < 0 else value
    return raster(path, weights, crs or FRAME.crs.to_wkt(), from_origin(-8.0, 8.0, 4.0, 4.0))


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (lambda f: _bad_raster(f / "p.tif", -1.0), "a weight of -1"),
        (lambda f: _bad_raster(f / "p.tif", 0.0), "weights that sum to 0"),
        (lambda f: _bad_raster(f / "p.tif", np.inf), "a weight of inf"),
        (lambda f: Prior(file=f / "absent.tif"), "what cannot be read"),
        (lambda f: Prior(file=f / "absent.geojson"), "no file"),
        (lambda f: polygons(f / "p.geojson", (0, 0, 5, -1.0)), r"features\.0.*found -1\.0"),
        (lambda f: polygons(f / "p.geojson", (0, 0, 5, 1.0), (9, 0, 5, "much")), r"features\.1.*'much'"),
        (lambda f: polygons(f / "p.geojson", (0, 0, 5, True)), "True"),
        (lambda f: polygons(f / "p.geojson", (0, 0, 5, 0)), "weights that sum to 0"),
        (lambda f: polygons(f / "p.geojson", (5000, 0, 50, 1)), "gives the map nothing"),
    ],
)
def test_what_is_no_prior_of_this_ground_is_refused_with_the_reason(tmp_path: Path, make, found: str) -> None:
    with pytest.raises(InputError, match=found):
        prior_is_on_terrain(make(tmp_path), TERRAIN)


def test_a_raster_without_a_crs_is_refused(tmp_path: Path) -> None:
    weights = np.ones((4, 4), dtype=np.float32)
    prior = raster(tmp_path / "p.tif", weights, None, from_origin(-8.0, 8.0, 4.0, 4.0))
    with pytest.raises(InputError, match="without a CRS"):
        area_probability(prior, TERRAIN)


def test_how_much_of_a_prior_is_on_the_map_is_said_and_little_is_warned_of() -> None:
    (little,) = prior_is_on_terrain(here((200.0, 1.0)), TERRAIN)
    assert (little.severity, little.cause) == ("warning", "prior_beyond_map")
    (most,) = prior_is_on_terrain(here((30.0, 0.9)), TERRAIN)
    assert most.severity == "assumed"
    assert "on this map with 90%, elsewhere with 10%" in most.found


@pytest.mark.parametrize(
    "said",
    [
        {},
        {"file": "p.tif", "last_known_point": {"latitude": {"degrees": 47}, "longitude": {"degrees": 8}}},
        {"last_known_point": {"latitude": {"degrees": 47}, "longitude": {"degrees": 8}}},
        {"file": "p.tif", "rings": [{"within": {"meters": 5}, "probability": 0.5}]},
        {"file": "p.tif", "inside": 1.5},
    ],
)
def test_what_says_nothing_or_two_things_is_refused(said: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        Prior.model_validate(said)


@pytest.mark.parametrize("rings", [[(10.0, 0.5), (5.0, 0.9)], [(10.0, 0.5), (20.0, 0.4)], [(10.0, 0.0)]])
def test_rings_that_do_not_rise_are_refused(rings: list[tuple[float, float]]) -> None:
    with pytest.raises(ValidationError):
        here(*rings)

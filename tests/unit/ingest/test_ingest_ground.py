"""The ground of a mission: whose datum a tile has, and what stands in where nothing is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from pyproj import Transformer
from rasterio.transform import from_origin

from pipeline.config.terrain import Terrain as TerrainSection
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.geoid import undulation_m
from pipeline.ingest.ground import GroundModel, load_ground, middle_of, window_about
from pipeline.ingest.track import Track

FRAME = LocalFrame(58.4021, 15.5752)
#: of FRAME's origin
EAST, NORTH = Transformer.from_crs("EPSG:4326", "EPSG:32633", always_xy=True).transform(15.5752, 58.4021)
WINDOW = (-60.0, -60.0, 60.0, 60.0)


def tile(
    path: Path, heights: NDArray[Any] | float, west: float = -60.0, cell: float = 1.5, crs: str = "EPSG:32633"
) -> Path:
    values = (
        np.full((120, 120), heights, np.float32) if isinstance(heights, float) else heights.astype(np.float32)
    )
    with rasterio.open(
        path, "w", driver="GTiff", width=values.shape[1], height=values.shape[0], count=1, dtype="float32", crs=crs,
        transform=from_origin(EAST + west, NORTH + 65.0, cell, cell),
    ) as target:  # fmt: skip
        target.write(values, 1)
    return path


def track(
    latitude: Any = 58.4021, longitude: Any = 15.5752, absolute: float = 130.0, relative: float = 20.0
) -> Track:
    latitude, longitude = np.broadcast_arrays(np.asarray(latitude, float), np.asarray(longitude, float))
    latitude, longitude = latitude.reshape(-1), longitude.reshape(-1)
    none = np.full(len(latitude), np.nan)
    return Track(
        0, np.arange(len(latitude), dtype=float), latitude, longitude, np.full(len(latitude), absolute),
        np.full(len(latitude), relative), none, none, none,
    )  # fmt: skip


def load(section: dict[str, Any], tracks: list[Track] | None = None) -> GroundModel:
    return load_ground(TerrainSection.model_validate(section), 1.0, FRAME, WINDOW, tracks or [track()])


def said(model: GroundModel, cause: str) -> list[str]:
    return [str(f) for f in model.findings if f.cause == cause]


GEOID = "EPSG:32633+5773"


@pytest.mark.parametrize("silent", [1, 2])
def test_a_tile_that_does_not_say_its_datum_takes_its_neighbours_aloud(tmp_path: Path, silent: int) -> None:
    files = [tile(tmp_path / "a.tif", 100.0, -60.0, 0.5, GEOID)]
    files += [tile(tmp_path / f"silent-{k}.tif", 100.0, 0.0, 0.5) for k in range(silent)]
    model = load({"file": [str(f) for f in files]})
    assert model.datum == "geoid"
    (finding,) = said(model, "datum")
    assert "count from the geoid, as those of its neighbours" in finding
    assert "silent-0.tif" in finding
    assert "a.tif" not in finding


def test_tiles_that_all_say_it_or_a_mission_that_does_leave_nothing_to_assume(tmp_path: Path) -> None:
    loud, silent = tile(tmp_path / "a.tif", 100.0, crs=GEOID), tile(tmp_path / "b.tif", 100.0)
    assert not said(load({"file": str(loud)}), "datum")
    assert not said(load({"file": [str(loud), str(silent)], "height_datum": "geoid"}), "datum")


def test_a_plane_stands_in_where_the_model_knows_nothing_and_is_stated(tmp_path: Path) -> None:
    heights = np.full((120, 120), 100.0)
    heights[40:50, 30:60] = np.nan
    path = tile(tmp_path / "dsm.tif", heights, west=-20.0, cell=1.2)
    model = load({"file": str(path), "fallback": {"height": {"meters": 93}, "sd": {"meters": 4}}})
    terrain = model.terrain
    assert not np.isnan(terrain.heights_m).any()
    for (east, north), height_m, sd_m in (
        ((30.0, -40.0), 100.0, 0.0),
        ((-50.0, 0.0), 93.0, 4.0),
        ((30.0, 12.0), 93.0, 4.0),
    ):
        assert terrain.height(east, north) == height_m
        assert terrain.extra_sd_m(*terrain.cell(east, north)) == sd_m
        assert model.ground.extra_sd_m(east, north) == sd_m
    assert model.ground.extra_sd_m(1e5, 0.0) == 0.0
    (finding,) = said(model, "terrain_fallback")
    assert "assumed: terrain.fallback: a plane at 93.0 m stands in for 36.3% of the ground" in finding
    assert "right to 4 m (one standard deviation)" in finding


def test_the_plane_of_a_fallback_without_a_height_is_that_of_take_off(tmp_path: Path) -> None:
    path = tile(tmp_path / "dsm.tif", 100.0, west=0.0)
    terrain = load({"file": str(path), "fallback": {}}, [track(absolute=131.5, relative=20.0)]).terrain
    assert terrain.height(-40.0, 0.0) == pytest.approx(111.5)
    assert terrain.extra_sd_m(*terrain.cell(-40.0, 0.0)) == 5.0


def test_a_coarse_model_stands_in_above_the_datum_of_the_fine_one(tmp_path: Path) -> None:
    geoid_m, _ = undulation_m(58.4021, 15.5752)
    fine = tile(tmp_path / "fine.tif", 100.0, west=0.0, crs="EPSG:32633")
    coarse = tile(
        tmp_path / "coarse.tif", np.full((14, 24), 100.0 - geoid_m), west=-120.0, cell=10.0, crs=GEOID
    )
    model = load({"file": str(fine), "height_datum": "ellipsoid", "fallback": {"file": str(coarse)}})
    assert model.terrain.height(-40.0, 0.0) == pytest.approx(100.0, abs=0.01)
    assert not said(model, "fallback_off")
    (finding,) = said(model, "terrain_fallback")
    assert "a coarser model stands in for 50." in finding
    assert f"the geoid being {geoid_m:.1f} m" in said(model, "datum")[0]
    told = {"file": str(coarse), "height_datum": "ellipsoid", "sd": {"meters": 2}}
    model = load({"file": str(fine), "height_datum": "ellipsoid", "fallback": told})
    assert model.terrain.height(-40.0, 0.0) == pytest.approx(100.0 - geoid_m, abs=0.01)
    (warning,) = said(model, "fallback_off")
    assert f"it is {-geoid_m:+.1f} m from the surface model" in warning


def test_a_fallback_without_a_datum_counts_as_the_terrain_aloud_and_fills_only_what_it_knows(
    tmp_path: Path,
) -> None:
    fine = tile(tmp_path / "fine.tif", 100.0, west=30.0, crs=GEOID)
    coarse = tile(tmp_path / "coarse.tif", np.full((14, 3), 98.0), west=-10.0, cell=10.0)
    model = load({"file": str(fine), "fallback": {"file": str(coarse)}})
    assert model.terrain.height(0.0, 0.0) == 98.0
    assert np.isnan(model.terrain.height(-40.0, 0.0))
    assert "count from the geoid, as the terrain's" in said(model, "datum")[0]


def test_a_fallback_that_is_not_needed_changes_and_says_nothing(tmp_path: Path) -> None:
    whole = tile(tmp_path / "dsm.tif", 100.0, west=-65.0)
    model = load({"file": str(whole), "height_datum": "ellipsoid", "fallback": {"height": {"meters": 1}}})
    assert model.terrain.stood_in is None
    assert model.findings == ()


def test_a_model_far_away_is_refused_with_a_fallback_too(tmp_path: Path) -> None:
    far = tile(tmp_path / "far.tif", 100.0, west=9000.0)
    with pytest.raises(InputError, match="far from the flights"):
        load({"file": str(far), "fallback": {"height": {"meters": 93}}})


@pytest.mark.parametrize(
    "section",
    [
        {"flat": {}, "fallback": {"height": {"meters": 1}}},
        {"file": "a.tif", "fallback": {"file": "b.tif", "height": {"meters": 1}}},
        {
            "file": "a.ply",
            "origin": {"latitude": {"degrees": 1}, "longitude": {"degrees": 1}},
            "fallback": {},
        },
    ],
)
def test_a_fallback_that_contradicts_itself_is_refused(section: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="mismatch"):
        TerrainSection.model_validate(section)


def test_a_folder_of_tiles_of_the_formats_that_they_come_in_is_read(tmp_path: Path) -> None:
    for name in ("N58E015.hgt", "n58.dt2", "a.TIF"):
        (tmp_path / name).write_bytes(b"")
    from pipeline.ingest.ground import files_of

    assert [p.name for p in files_of(TerrainSection(file=tmp_path))] == ["N58E015.hgt", "a.TIF", "n58.dt2"]


def test_a_tile_of_srtm_counts_from_the_geoid_as_its_format_says(tmp_path: Path) -> None:
    from pipeline.geo.surface_model import inspect

    heights = np.full((1201, 1201), 100, np.dtype(">i2"))
    (tmp_path / "N58E015.hgt").write_bytes(heights.tobytes())
    assert inspect(tmp_path / "N58E015.hgt").datum == "geoid"


@pytest.mark.parametrize(
    ("latitude", "longitudes", "middle"),
    [
        (-17.0, [179.9995, -179.9995], 180.0), (65.0, [-179.999, 179.998], 179.9995), (-54.8, [-68.31, -68.29], -68.3),
        (84.0, [11.99, 12.01], 12.0), (-77.8, [166.6, 166.62], 166.61),
    ],
)  # fmt: skip
def test_flights_on_the_antimeridian_near_the_poles_and_in_the_south_have_their_middle_and_window(
    latitude: float, longitudes: list[float], middle: float
) -> None:
    flights = [track(latitude, longitude) for longitude in longitudes]
    frame = middle_of(flights)
    assert frame.origin_latitude_deg == pytest.approx(latitude)
    assert (frame.origin_longitude_deg - middle + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-9)
    window = window_about(flights, frame, 100.0)
    assert window is not None
    apart_deg = (longitudes[1] - longitudes[0] + 180.0) % 360.0 - 180.0
    width_m = abs(apart_deg) * 111_320.0 * np.cos(np.radians(latitude))
    assert window[2] - window[0] == pytest.approx(200.0 + width_m, rel=0.01)
    assert window[3] - window[1] == pytest.approx(200.0, abs=1.0)


@pytest.mark.parametrize("latitude", [-90.0, -77.8, 0.0, 84.0, 90.0])
def test_the_geoid_is_the_same_from_both_sides_of_the_antimeridian(latitude: float) -> None:
    east, west = undulation_m(latitude, 180.0), undulation_m(latitude, -180.0)
    assert east == pytest.approx(west)
    assert undulation_m(latitude, 179.9999)[0] == pytest.approx(
        undulation_m(latitude, -179.9999)[0], abs=0.01
    )

"""One plane, h = 100 + 0.1 E + 0.05 N, under every encoding that people use: its height comes out at any point."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pyproj import Transformer
from rasterio.enums import ColorInterp
from rasterio.transform import Affine, from_origin

from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.surface_model import SurfaceModel, inspect
from pipeline.geo.terrain import Terrain, frame_of, load_terrain

SHARED = Path(__file__).parents[4] / "shared/data/cases/terrain"
FEET, SURVEY_FEET = 0.3048, 1200.0 / 3937.0
SIZE = 120
UTM = "EPSG:32633"
WEST, NORTH = 533_495.0, 6_473_682.0


def plane(transform: Affine, crs: str, shape: tuple[int, int], frame: LocalFrame) -> NDArray[np.float64]:
    rows, columns = np.mgrid[: shape[0], : shape[1]] + 0.5
    x, y = transform * (columns, rows)
    east, north = Transformer.from_crs(crs, frame.crs, always_xy=True).transform(x, y)
    return np.asarray(100.0 + 0.1 * np.asarray(east) + 0.05 * np.asarray(north))


def write(
    path: Path, values: NDArray[Any], crs: str = UTM, transform: Affine | None = None, **given: Any
) -> Path:
    tags = {key: given.pop(key) for key in ("units", "scales", "offsets") if key in given}
    profile = {
        "driver": "GTiff",
        "height": values.shape[-2],
        "width": values.shape[-1],
        "count": 1 if values.ndim == 2 else values.shape[0],
        "dtype": values.dtype,
        "crs": crs,
        "transform": transform or from_origin(WEST, NORTH, 1.0, 1.0),
    }
    with rasterio.open(path, "w", **(profile | given)) as target:
        target.write(values if values.ndim == 3 else values[None])
        for name, value in tags.items():
            setattr(target, name, (value,))
    return path


def made(
    path: Path, change: Callable[[NDArray[np.float64]], NDArray[Any]], crs: str = UTM, **given: Any
) -> Path:
    transform = given.pop("transform", from_origin(WEST, NORTH, 1.0, 1.0))
    blank = write(path, np.ones((SIZE, SIZE), np.float32), crs, transform)
    heights = plane(transform, crs, (SIZE, SIZE), frame_of(blank))
    return write(path, change(heights), crs, transform, **given)


def load(path: Path, cell_m: float = 1.0, **given: Any) -> tuple[Terrain, SurfaceModel]:
    model = inspect(path, **given)
    return load_terrain([model], cell_m, frame_of(path)), model


def f32(heights: NDArray[np.float64]) -> NDArray[np.float32]:
    return heights.astype(np.float32)


def centimetres(heights: NDArray[np.float64]) -> NDArray[np.int16]:
    return np.round((heights - 100.0) / 0.01).astype(np.int16)


ENCODINGS: dict[str, tuple[Callable[[NDArray[np.float64]], NDArray[Any]], dict[str, Any]]] = {
    "metres": (f32, {}),
    "US survey feet, by the band": (lambda h: f32(h / SURVEY_FEET), {"units": "US survey foot"}),
    "international feet, by the band": (lambda h: f32(h / FEET), {"units": "ft"}),
    "US survey feet, by the CRS": (lambda h: f32(h / SURVEY_FEET), {"crs": "EPSG:32633+6360"}),
    "integers with scale and offset": (centimetres, {"scales": 0.01, "offsets": 100.0}),
    "unsigned decimetres": (lambda h: np.round(h * 10.0).astype(np.uint16), {"units": "dm"}),
    "doubles": (lambda h: h, {}),
    "north down": (f32, {"transform": Affine(1.0, 0.0, WEST, 0.0, 1.0, NORTH - SIZE)}),
    "turned": (f32, {"transform": from_origin(WEST, NORTH, 1.0, 1.0) * Affine.rotation(30.0)}),
    "degrees": (f32, {"crs": "EPSG:4326", "transform": from_origin(15.57, 58.40, 2e-5, 1e-5)}),
    "feet of distance": (f32, {"crs": "EPSG:2263", "transform": from_origin(985_000.0, 200_000.0, 3.0, 3.0)}),
    "the southern hemisphere": (f32, {"crs": "EPSG:32756", "transform": from_origin(334_000.0, 6_250_000.0, 1.0, 1.0)}),
    "near the north pole": (f32, {"crs": "EPSG:32661", "transform": from_origin(2_000_300.0, 2_000_300.0, 1.0, 1.0)}),
    "near the south pole": (f32, {"crs": "EPSG:3031", "transform": from_origin(-300.0, 200.0, 1.0, 1.0)}),
    "degrees in Antarctica": (f32, {"crs": "EPSG:4326", "transform": from_origin(166.6, -77.8, 4e-5, 1e-5)}),
    "degrees on Spitsbergen": (f32, {"crs": "EPSG:4326", "transform": from_origin(11.9, 78.9, 4e-5, 1e-5)}),
    "degrees in the south-west": (f32, {"crs": "EPSG:4326", "transform": from_origin(-68.3, -54.8, 2e-5, 1e-5)}),
    "across the antimeridian": (f32, {"crs": "EPSG:4326", "transform": from_origin(179.9994, -17.0, 1e-5, 1e-5)}),
    "beyond 180 degrees": (f32, {"crs": "EPSG:4326", "transform": from_origin(190.0, 65.0, 2e-5, 1e-5)}),
}  # fmt: skip


@pytest.mark.parametrize("name", ENCODINGS)
def test_the_plane_comes_out_of_every_encoding(tmp_path: Path, name: str) -> None:
    change, given = ENCODINGS[name]
    terrain, _ = load(made(tmp_path / "dsm.tif", change, **given))
    rng = np.random.default_rng(1)
    rows, columns = terrain.shape
    seen = 0
    for _ in range(40):
        east = terrain.east_m + rng.uniform(0.3, 0.7) * columns * terrain.cell_m
        north = terrain.north_m + rng.uniform(0.3, 0.7) * rows * terrain.cell_m
        height = terrain.height(east, north)
        if np.isfinite(height):
            seen += 1
            assert height == pytest.approx(100.0 + 0.1 * east + 0.05 * north, abs=0.06)
    assert seen > 30


@settings(max_examples=15, deadline=None)
@given(
    st.sampled_from([0.5, 1.0, 2.5]),
    st.floats(0.1, 2.0),
    st.sampled_from(["EPSG:32633", "EPSG:3006", "EPSG:25832"]),
)
def test_the_plane_comes_out_at_any_resolution_and_in_any_zone(
    tmp_path_factory: pytest.TempPathFactory, cell_m: float, pixel_m: float, crs: str
) -> None:
    path = tmp_path_factory.mktemp("dsm") / "dsm.tif"
    terrain, _ = load(made(path, f32, crs, transform=from_origin(533_000.0, NORTH, pixel_m, pixel_m)), cell_m)
    assert terrain.height(0.0, 0.0) == pytest.approx(100.0, abs=0.05)
    assert terrain.height(5.0, -5.0) == pytest.approx(100.25, abs=0.08)


@pytest.mark.parametrize(
    ("value", "dtype"),
    [(-9999.0, "float32"), (-32768, "int16"), (-3.4028235e38, "float32"), (np.nan, "float32"), (1e20, "float32")],
)  # fmt: skip
def test_what_is_no_height_is_unknown_though_no_tag_says_so(tmp_path: Path, value: float, dtype: str) -> None:
    def spoil(heights: NDArray[np.float64]) -> NDArray[Any]:
        values = np.round(heights).astype(dtype)
        values[50:60, 50:60] = value
        return values

    terrain, model = load(made(tmp_path / "dsm.tif", spoil))
    hole = terrain.cells(np.array([[-5.0, 5.0]]))[0]
    assert np.isnan(terrain.heights_m[tuple(hole)])
    assert np.nanmin(terrain.heights_m) > 80.0
    assert np.isnan(value) or any("no heights" in note for note in model.notes)


@pytest.mark.parametrize("given", [{"units": "cm"}, {"scales": 0.01}, {"scales": 0.01, "offsets": 50.0}])
@pytest.mark.parametrize("value", [-9999, -32768])
def test_a_sentinel_is_no_height_whatever_scale_or_unit_the_band_has(
    tmp_path: Path, value: int, given: dict[str, Any]
) -> None:
    def spoil(heights: NDArray[np.float64]) -> NDArray[Any]:
        values = np.round((heights - given.get("offsets", 0.0)) / 0.01).astype(np.int16)
        values[50:60, 50:60] = value
        return values

    terrain, model = load(made(tmp_path / "dsm.tif", spoil, **given))
    assert np.isnan(terrain.heights_m[tuple(terrain.cells(np.array([[-5.0, 5.0]]))[0])])
    assert np.nanmin(terrain.heights_m) > 80.0
    assert any("no heights" in note for note in model.notes)


def test_one_cell_of_many_is_less_than_a_tenth_of_a_percent_and_not_none(tmp_path: Path) -> None:
    def spoil(heights: NDArray[np.float64]) -> NDArray[Any]:
        values = f32(heights)
        values[60, 60] = -9999.0
        return values

    _, model = load(made(tmp_path / "dsm.tif", spoil))
    (note,) = model.notes
    assert note.startswith("less than 0.1% of the cells hold [-9999.0]")


@pytest.mark.parametrize("nodata", [-9999.0, 0.0, 95.0])
def test_a_nodata_value_is_honoured_whatever_it_is(tmp_path: Path, nodata: float) -> None:
    def spoil(heights: NDArray[np.float64]) -> NDArray[Any]:
        values = f32(heights)
        values[50:60, 50:60] = nodata
        return values

    terrain, _ = load(made(tmp_path / "dsm.tif", spoil, nodata=nodata))
    assert np.isnan(terrain.heights_m[tuple(terrain.cells(np.array([[-5.0, 5.0]]))[0])])


def test_a_border_of_zeros_beside_high_ground_is_unknown_and_a_sea_at_zero_stays(tmp_path: Path) -> None:
    def border(heights: NDArray[np.float64]) -> NDArray[Any]:
        values = f32(heights)
        values[:20] = values[:, :20] = 0.0
        return values

    def sea(heights: NDArray[np.float64]) -> NDArray[Any]:
        return f32(np.maximum(heights - 100.0, 0.0))

    terrain, model = load(made(tmp_path / "border.tif", border))
    assert np.nanmin(terrain.heights_m) > 50.0
    assert any("zeros" in note for note in model.notes)
    terrain, model = load(made(tmp_path / "sea.tif", sea))
    assert terrain.height(-50.0, -10.0) == 0.0
    assert model.notes == ()


@pytest.mark.parametrize(
    ("crs", "datum"),
    [(UTM, None), (UTM + "+5773", "geoid"), ("EPSG:4979", "ellipsoid"), ("EPSG:25832+7837", "geoid")],
)  # fmt: skip
def test_the_datum_is_that_of_the_crs(tmp_path: Path, crs: str, datum: str | None) -> None:
    transform = from_origin(15.57, 58.4, 1e-5, 1e-5) if "4979" in crs else None
    assert (
        inspect(write(tmp_path / "dsm.tif", np.full((20, 20), 5.0, np.float32), crs, transform)).datum
        == datum
    )


@pytest.mark.parametrize(
    ("values", "given", "found"),
    [
        (np.zeros((3, 20, 20), np.uint8), {}, "a picture or a mask"),
        (np.zeros((20, 20), np.uint8), {}, "a picture or a mask"),
        (np.zeros((4, 20, 20), np.float32), {}, "a picture or a mask"),
        (np.zeros((20, 20), np.complex64), {}, "a picture or a mask"),
        (np.zeros((20, 20), np.float32), {"transform": Affine.identity()}, "georeference: found none"),
        (np.zeros((20, 20), np.float32), {"crs": None}, "CRS: found none"),
        (np.zeros((20, 20), np.float32), {"units": "furlong"}, "band unit: found 'furlong'"),
        (np.zeros((20, 20), np.float32), {"scales": 0.0}, "scale, offset"),
    ],
)
def test_what_is_no_surface_model_is_refused(
    tmp_path: Path, values: NDArray[Any], given: dict[str, Any], found: str
) -> None:
    path = write(tmp_path / "dsm.tif", values, **given)
    with pytest.raises(InputError, match=found):
        inspect(path)


def test_a_file_that_is_cut_off_is_refused(tmp_path: Path) -> None:
    path = made(tmp_path / "dsm.tif", f32)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(InputError, match="cannot be read whole"):
        load(path)


def test_tiles_make_one_terrain_without_a_gap_and_the_first_that_knows_a_height_counts(
    tmp_path: Path,
) -> None:
    whole = made(tmp_path / "whole.tif", f32)
    frame = frame_of(whole)
    with rasterio.open(whole) as source:
        heights = source.read(1)
    left = write(tmp_path / "left.tif", heights[:, :60])
    right = write(
        tmp_path / "right.tif", heights[:, 60:], transform=from_origin(WEST + 60.0, NORTH, 1.0, 1.0)
    )
    coarse = write(tmp_path / "coarse.tif", np.full((40, 40), 7.0, np.float32),
                   transform=from_origin(WEST - 40.0, NORTH, 5.0, 5.0))  # fmt: skip
    models = [inspect(p) for p in (left, right, coarse)]
    terrain = load_terrain(models, 1.0, frame, (-70.0, -40.0, 50.0, 40.0))
    assert not np.isnan(terrain.heights_m).any()
    for east in np.arange(-50.0, 45.0, 3.3):
        assert terrain.height(east, 3.0) == pytest.approx(100.15 + 0.1 * east, abs=0.06)
    assert terrain.height(-68.0, 0.0) == pytest.approx(7.0, abs=0.1)


@pytest.mark.parametrize("latitude", [-17.0, 65.0, -77.8])
def test_tiles_on_both_sides_of_the_antimeridian_make_one_terrain(tmp_path: Path, latitude: float) -> None:
    frame = LocalFrame(latitude, 180.0)
    step = 1e-5 / np.cos(np.radians(latitude))

    def tile(name: str, west: float) -> SurfaceModel:
        transform = Affine(step, 0.0, west, 0.0, -1e-5, latitude + 60e-5)
        return inspect(
            write(
                tmp_path / name,
                f32(plane(transform, "EPSG:4326", (SIZE, SIZE), frame)),
                "EPSG:4326",
                transform,
            )
        )

    models = [tile("east.tif", 180.0 - SIZE * step), tile("west.tif", -180.0)]
    terrain = load_terrain(models, 1.0, frame, (-60.0, -50.0, 60.0, 50.0))
    assert not np.isnan(terrain.heights_m).any()
    for east in np.arange(-55.0, 56.0, 5.5):
        assert terrain.height(east, 3.0) == pytest.approx(100.15 + 0.1 * east, abs=0.08)


def test_only_the_window_is_loaded_and_its_cells_are_the_same(tmp_path: Path) -> None:
    path = made(tmp_path / "dsm.tif", f32)
    whole, _ = load(path)
    part = load_terrain([inspect(path)], 1.0, frame_of(path), (-20.3, -10.2, 15.7, 22.0))
    row, column = int(part.north_m - whole.north_m), int(part.east_m - whole.east_m)
    rows, columns = part.shape
    assert (rows, columns) == (33, 37)
    np.testing.assert_allclose(
        part.heights_m, whole.heights_m[row : row + rows, column : column + columns], atol=1e-3
    )
    with pytest.raises(InputError, match="far from the flights"):
        load_terrain([inspect(path)], 1.0, frame_of(path), (900.0, 900.0, 990.0, 990.0))


@pytest.mark.parametrize("name", ["feet_unit.tif", "compound_ft.tif", "scale_int16.tif", "untagged_9999.tif"])
def test_a_shared_model_has_its_height_at_the_centre(name: str) -> None:
    if not SHARED.exists():
        pytest.skip("no shared data beside the repository")
    terrain, _ = load(SHARED / name)
    assert terrain.height(0.0, 0.0) == pytest.approx(100.0, abs=0.1)
    assert np.nanmin(terrain.heights_m) > 80.0


@pytest.mark.parametrize(
    ("name", "found"),
    [("rgb_ortho.tif", "a picture"), ("no_georef.tif", "georeference"), ("dem_truncated.tif", "cannot be read")],
)  # fmt: skip
def test_a_shared_raster_that_is_no_model_is_refused(name: str, found: str) -> None:
    if not SHARED.exists():
        pytest.skip("no shared data beside the repository")
    with pytest.raises(InputError, match=found):
        load(SHARED / name)


def masked(folder: Path, name: str) -> Path:
    """The plane with a hole of zeros that only a mask, an alpha band or nothing at all tells from ground."""
    blank = write(folder / "blank.tif", np.ones((SIZE, SIZE), np.float32))
    heights = f32(plane(from_origin(WEST, NORTH, 1.0, 1.0), UTM, (SIZE, SIZE), frame_of(blank)))
    heights[40:60, 40:60] = 0.0
    known = np.full((SIZE, SIZE), 255, np.uint8)
    known[40:60, 40:60] = 0
    path = folder / f"{name}.tif"
    if name == "alpha":
        write(path, np.stack([heights, known.astype(np.float32)]))
        with rasterio.open(path, "r+") as target:
            target.colorinterp = [ColorInterp.gray, ColorInterp.alpha]
        return path
    write(path, heights)
    if name != "nothing":
        with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=name == "inside"), rasterio.open(path, "r+") as target:
            target.write_mask(known)
    return path


@pytest.mark.parametrize("name", ["inside", "beside", "alpha", "nothing"])
def test_a_hole_is_unknown_whoever_says_that_it_is_one(tmp_path: Path, name: str) -> None:
    terrain, model = load(masked(tmp_path, name))
    assert np.isnan(terrain.height(-10.0, 10.0))
    assert terrain.height(-40.0, 40.0) == pytest.approx(98.0, abs=0.1)
    assert model.zero_is_unknown == (name == "nothing")


def test_a_lake_at_zero_with_flat_shores_stays(tmp_path: Path) -> None:
    distance = np.hypot(*(np.mgrid[:SIZE, :SIZE] - 60.0))
    path = write(tmp_path / "lake.tif", np.maximum(0.0, 0.3 * (distance - 20.0)).astype(np.float32))
    terrain, model = load(path)
    assert not model.zero_is_unknown
    assert terrain.height(0.0, 0.0) == 0.0


def test_a_grid_without_a_crs_says_how_to_give_it_one_and_takes_it(tmp_path: Path) -> None:
    rows = "\n".join(" ".join(f"{100 + 0.1 * (c - 60):.2f}" for c in range(SIZE)) for _ in range(SIZE))
    grid = tmp_path / "tile.asc"
    head = f"ncols {SIZE}\nnrows {SIZE}\nxllcorner {WEST}\nyllcorner {NORTH - SIZE}\ncellsize 1\nNODATA_value -9999\n"
    grid.write_text(head + rows + "\n", encoding="ascii")
    with pytest.raises(InputError, match=r"CRS: found none; .*\.prj beside it"):
        inspect(grid)
    grid.with_suffix(".prj").write_text(
        rasterio.crs.CRS.from_epsg(32633).to_wkt("WKT1_ESRI"), encoding="ascii"
    )
    assert load(grid)[0].height(0.0, 0.0) == pytest.approx(100.0, abs=0.1)


def millimetres(heights: NDArray[np.float64]) -> NDArray[np.int32]:
    return np.round(1000.0 * heights).astype(np.int32)


def test_heights_in_millimetres_are_read_where_it_is_said_and_named_where_not(tmp_path: Path) -> None:
    said = load(made(tmp_path / "said.tif", millimetres, units="mm"))[0]
    told = load(made(tmp_path / "told.tif", millimetres), unit="millimeters")[0]
    assert said.height(0.0, 0.0) == told.height(0.0, 0.0) == pytest.approx(100.0, abs=0.1)
    with pytest.raises(InputError, match=r"terrain\.unit, if they are centimeters or millimeters"):
        inspect(made(tmp_path / "unsaid.tif", millimetres))

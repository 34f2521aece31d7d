from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.surface_model import inspect
from pipeline.geo.terrain import Terrain, frame_of, load_terrain

FRAME = LocalFrame(47.0, 8.0)


def load(path: Path, cell_m: float, folder: Path | None = None) -> Terrain:
    return load_terrain([inspect(path)], cell_m, frame_of(path), folder=folder)


def _slope(cell_m: float = 0.5, up_per_east: float = 0.1, up_per_north: float = -0.2) -> Terrain:
    """20 m x 30 m, its south-west corner at (-10, 5)."""
    rows, columns = np.mgrid[: int(30.0 / cell_m), : int(20.0 / cell_m)]
    east, north = -10.0 + (columns + 0.5) * cell_m, 5.0 + (rows + 0.5) * cell_m
    heights = (up_per_east * east + up_per_north * north).astype(np.float32)
    return Terrain(FRAME, -10.0, 5.0, cell_m, heights)


def test_the_centres_of_cells_are_in_their_cells():
    terrain = _slope()
    rows, columns = np.indices(terrain.shape).reshape(2, -1)
    cells = terrain.cells(terrain.centers(rows, columns))
    np.testing.assert_array_equal(cells, np.stack([rows, columns], axis=1))


def test_points_outside_have_no_cell():
    outside = np.array([[-10.1, 6.0], [10.0, 6.0], [0.0, 4.9], [0.0, 35.0], [np.nan, 6.0]])
    np.testing.assert_array_equal(_slope().cells(outside), -1)


def test_the_corner_cell_is_the_south_west_one():
    np.testing.assert_array_equal(_slope().cells(np.array([[-9.9, 5.1], [9.9, 34.9]])), [[0, 0], [59, 39]])


def test_a_slope_is_a_slope_between_the_centres():
    terrain = _slope()
    for east, north in [(-9.0, 7.0), (0.33, 20.21), (9.7, 34.7)]:
        assert terrain.height(east, north) == pytest.approx(0.1 * east - 0.2 * north, abs=1e-5)


def test_the_height_outside_or_where_unknown_is_nan():
    terrain = _slope()
    terrain.heights_m[10, 10] = np.nan
    assert np.isnan(terrain.height(-10.1, 6.0))
    assert np.isnan(terrain.height(0.0, 35.1))
    assert np.isnan(terrain.height(-10.0 + 10.4 * 0.5, 5.0 + 10.4 * 0.5))


def test_a_ray_meets_a_slope_where_the_plane_equation_says():
    terrain, origin = _slope(), np.array([1.0, 10.0, 12.0])
    direction = np.array([0.2, 0.5, -0.7]) / np.linalg.norm([0.2, 0.5, -0.7])
    t = (0.1 * origin[0] - 0.2 * origin[1] - origin[2]) / (direction @ np.array([-0.1, 0.2, 1.0]))
    hit = terrain.intersect(origin, direction, 100.0)
    assert hit is not None
    np.testing.assert_allclose(hit, origin + t * direction, atol=0.01)


def test_a_ray_stops_at_the_first_thing():
    terrain = _slope(up_per_east=0.0, up_per_north=0.0)
    terrain.heights_m[20:24, :] = 4.0  # 15 m .. 17 m north
    hit = terrain.intersect(np.array([0.0, 8.0, 5.0]), np.array([0.0, 0.9, -0.3]) / np.hypot(0.9, 0.3), 100.0)
    assert hit is not None
    assert 14.7 < hit[1] < 15.3
    assert hit[2] > 1.0


@pytest.mark.parametrize(
    ("direction", "reach"), [((0.0, 0.0, 1.0), 100.0), ((0.0, 0.0, -1.0), 5.0), ((0.0, -1.0, 0.0), 100.0)]
)
def test_a_ray_that_meets_nothing_within_reach_has_no_point(direction, reach):
    assert _slope().intersect(np.array([0.0, 10.0, 12.0]), np.array(direction), reach) is None


def _write(path, heights, transform, crs, nodata=None):
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=heights.shape[1],
        height=heights.shape[0],
        count=1,
        dtype="float32",
        crs=crs,
        transform=transform,
        nodata=nodata,
    ) as sink:
        sink.write(heights.astype(np.float32), 1)


def _plane_file(path, cell_m=0.5, side=200, nodata=None):
    """A plane in UTM 32 that rises to the east and, less, to the north; 300 m high at its middle."""
    rows, columns = np.mgrid[:side, :side]
    east, north = (columns + 0.5 - side / 2) * cell_m, (side / 2 - rows - 0.5) * cell_m
    heights = 300.0 + 0.2 * east + 0.05 * north
    if nodata is not None:
        heights[:20, :20] = nodata
    corner = from_origin(500000.0 - side / 2 * cell_m, 5200000.0 + side / 2 * cell_m, cell_m, cell_m)
    _write(path, heights, corner, "EPSG:32632", nodata)


@pytest.mark.parametrize("cell_m", [0.25, 0.5, 2.0])
def test_a_loaded_plane_has_its_heights_at_its_places(tmp_path, cell_m):
    _plane_file(tmp_path / "dsm.tif")
    terrain = load(tmp_path / "dsm.tif", cell_m)
    # UTM's scale is 0.9996 on its central meridian, where the grid's north is true north
    for east, north in [(0.0, 0.0), (30.0, 10.0), (-20.0, -35.0)]:
        assert terrain.height(east, north) == pytest.approx(300.0 + 0.2 * east + 0.05 * north, abs=0.03)
    assert terrain.shape == pytest.approx((100.0 / cell_m, 100.0 / cell_m), abs=3)
    assert terrain.heights_m.dtype == np.float32


def test_the_frame_of_a_surface_model_has_its_origin_in_the_middle(tmp_path):
    _plane_file(tmp_path / "dsm.tif")
    frame = frame_of(tmp_path / "dsm.tif")
    assert frame.origin_longitude_deg == pytest.approx(9.0, abs=1e-5)


def test_cells_without_data_are_nan(tmp_path):
    _plane_file(tmp_path / "dsm.tif", nodata=-9999.0)
    terrain = load(tmp_path / "dsm.tif", 0.5)
    assert np.isnan(terrain.height(-45.0, 45.0))  # the north-west corner
    assert np.nanmin(terrain.heights_m) > 280.0


def test_a_geographic_surface_model_is_read_too(tmp_path):
    heights = np.full((50, 50), 123.0)
    _write(tmp_path / "dsm.tif", heights, from_origin(8.0, 47.0, 1e-5, 1e-5), "EPSG:4326")
    terrain = load(tmp_path / "dsm.tif", 0.5)
    assert terrain.height(0.0, 0.0) == pytest.approx(123.0)


def test_a_surface_model_that_cannot_be_used_is_refused(tmp_path):
    with pytest.raises(InputError, match="no file"):
        load(tmp_path / "none.tif", 0.5)
    (tmp_path / "text.tif").write_text("no raster")
    with pytest.raises(InputError, match="not a raster"):
        load(tmp_path / "text.tif", 0.5)
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        _write(tmp_path / "bare.tif", np.zeros((4, 4)), from_origin(0.0, 0.0, 1.0, 1.0), None)
    with pytest.raises(InputError, match="CRS"):
        load(tmp_path / "bare.tif", 0.5)
    _write(tmp_path / "huge.tif", np.zeros((4, 4)), from_origin(0.0, 0.0, 1e4, 1e4), "EPSG:32632")
    with pytest.raises(InputError, match="cell_size"):
        load(tmp_path / "huge.tif", 0.1)
    _write(
        tmp_path / "empty.tif", np.full((4, 4), -1.0), from_origin(5e5, 5.2e6, 1.0, 1.0), "EPSG:32632", -1.0
    )
    with pytest.raises(InputError, match="no height"):
        load(tmp_path / "empty.tif", 0.5)


def test_a_terrain_on_disk_is_the_one_in_memory_and_leaves_no_file(tmp_path):
    _plane_file(tmp_path / "dsm.tif", side=700, nodata=-9999.0)
    in_memory = load(tmp_path / "dsm.tif", 0.5)
    on_disk = load(tmp_path / "dsm.tif", 0.5, folder=tmp_path)
    assert on_disk.shape == in_memory.shape
    assert (on_disk.east_m, on_disk.north_m) == (in_memory.east_m, in_memory.north_m)
    np.testing.assert_allclose(on_disk.heights_m, in_memory.heights_m, atol=0.02)
    window = (100, 50, 300, 90)
    np.testing.assert_allclose(on_disk.height_range(window), in_memory.height_range(window), atol=0.02)
    assert on_disk.height(10.0, 20.0) == pytest.approx(in_memory.height(10.0, 20.0), abs=0.02)
    assert [p.name for p in tmp_path.iterdir()] == ["dsm.tif"]


def test_a_terrain_on_disk_without_heights_is_refused(tmp_path):
    _write(
        tmp_path / "empty.tif", np.full((4, 4), -1.0), from_origin(5e5, 5.2e6, 1.0, 1.0), "EPSG:32632", -1.0
    )
    with pytest.raises(InputError, match="no height"):
        load(tmp_path / "empty.tif", 0.5, folder=tmp_path)


def test_the_height_range_bounds_the_heights_of_a_window():
    rng = np.random.default_rng(0)
    heights = rng.normal(size=(150, 200)).astype(np.float32)
    heights[:70, :70] = np.nan
    terrain = Terrain(FRAME, 0.0, 0.0, 1.0, heights)
    for row, column, rows, columns in rng.integers(1, 75, (20, 4)):
        low, high = terrain.height_range((row, column, rows, columns))
        part = heights[row : row + rows, column : column + columns]
        if np.isfinite(part).any():
            assert low <= np.nanmin(part) <= np.nanmax(part) <= high
    assert terrain.height_range((0, 0, 64, 64)) == (np.inf, -np.inf)
    assert terrain.height_range((0, 0, 0, 64)) == (np.inf, -np.inf)
    assert terrain.height_range((64, 128, 10, 10)) == (
        heights[64:128, 128:192].min(),
        heights[64:128, 128:192].max(),
    )


def test_the_cell_of_a_position_is_that_of_the_points():
    terrain = _slope()
    points = np.random.default_rng(0).uniform(-15.0, 40.0, (200, 2))
    for point, cell in zip(points, terrain.cells(points), strict=True):
        assert terrain.cell(*point) == tuple(cell)
    assert terrain.cell(float("nan"), 6.0) == (-1, -1)

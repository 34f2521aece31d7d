"""Cover lies where its file says, whatever the file's kind, and a file that is none is refused in one line."""

import json

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from pipeline.errors import InputError
from pipeline.geo.cover import CoverFile, with_cover
from pipeline.geo.frame import LocalFrame
from pipeline.geo.surfaces import plane

FRAME = LocalFrame(47.0, 8.0)
TERRAIN = plane(FRAME, -20.0, -10.0, 20.0, 10.0, 0.5, 0.0)


def polygon(path, west, south, east, north):
    corners = np.array([[west, south], [east, south], [east, north], [west, north], [west, south]], float)
    lat, lon = FRAME.wgs84_from_enu(corners[:, 0], corners[:, 1])
    ring = [[float(x), float(y)] for x, y in zip(lon, lat, strict=True)]
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    return path


def raster(path, values, west, north, cell_m, **profile):
    values = np.asarray(values)
    profile = {
        "driver": "GTiff", "height": values.shape[0], "width": values.shape[1], "count": 1,
        "dtype": values.dtype, "crs": FRAME.crs.to_wkt(), "transform": from_origin(west, north, cell_m, cell_m),
    } | profile  # fmt: skip
    with rasterio.open(path, "w", **profile) as target:
        for band in range(profile["count"]):
            target.write(values, band + 1)
    return path


def at(terrain, east, north):
    return float(terrain.cover[terrain.cell(east, north)])


def test_polygons_cover_the_cells_whose_middle_they_hold_and_the_greatest_share_counts(tmp_path):
    wood = polygon(tmp_path / "wood.geojson", -20.0, -10.0, 0.0, 0.0)
    thicket = polygon(tmp_path / "thicket.geojson", -5.0, -10.0, 5.0, 10.0)
    covered = with_cover(TERRAIN, [CoverFile(wood, 0.6), CoverFile(thicket, 0.3)])
    assert at(covered, -10.0, -5.0) == pytest.approx(0.6)
    assert at(covered, -2.0, -5.0) == pytest.approx(0.6)
    assert at(covered, -2.0, 5.0) == pytest.approx(0.3)
    assert at(covered, 10.0, 5.0) == 0.0
    assert covered.cover.mean() == pytest.approx(0.6 * 0.25 + 0.3 * (0.25 - 0.0625), abs=0.01)


def test_a_raster_is_averaged_over_the_cells_and_says_nothing_where_it_is_nodata(tmp_path):
    values = np.array([[0, 100], [50, 255]], np.uint8)
    path = raster(tmp_path / "canopy.tif", values, -20.0, 10.0, 10.0, nodata=255)
    covered = with_cover(TERRAIN, [CoverFile(path, None, 100.0)])
    assert [at(covered, *p) for p in ((-15, 5), (-5, 5), (-15, -5), (-5, -5), (5, 5))] == [0, 1, 0.5, 0, 0]


def test_a_raster_in_degrees_is_where_its_crs_says(tmp_path):
    lat, lon = FRAME.wgs84_from_enu(np.array([-10.0, 10.0]), np.array([-5.0, 5.0]))
    size = float(lon[1] - lon[0]), float(lat[1] - lat[0])
    place = from_origin(float(lon[0]), float(lat[1]), size[0] / 40, size[1] / 40)
    values = np.full((40, 40), 0.25, np.float32)
    path = raster(tmp_path / "c.tif", values, 0, 0, 1, crs="EPSG:4326", transform=place)
    covered = with_cover(TERRAIN, [CoverFile(path, None)])
    assert at(covered, 0.0, 0.0) == pytest.approx(0.25)
    assert at(covered, 0.0, 7.0) == 0.0
    # and the cells that it covers in part
    assert 0.25 * 200.0 <= covered.cover.sum() * 0.5**2 <= 0.25 * 20.5 * 10.5 + 0.01


def test_without_cover_the_terrain_is_what_it_was():
    assert with_cover(TERRAIN, []) is TERRAIN


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda f: CoverFile(f / "none.tif", None), "no file"),
        (lambda f: CoverFile(f / "none.geojson", 0.5), "no file"),
        (lambda f: CoverFile(raster(f / "a.tif", np.full((4, 4), 45.0), -20, 10, 5), None), "a value of 45"),
        (lambda f: CoverFile(raster(f / "b.tif", np.full((4, 4), -1.0), -20, 10, 5), None), "a value of -1"),
        (lambda f: CoverFile(raster(f / "p.tif", np.full((4, 4), 140.0), -20, 10, 5), None, 100.0), "140"),
        (lambda f: CoverFile(raster(f / "c.tif", np.ones((4, 4)), -20, 10, 5, count=3), None), "3 bands"),
        (lambda f: CoverFile(raster(f / "d.tif", np.ones((4, 4)), 900, 10, 5), None), "does not meet"),
        (lambda f: CoverFile(polygon(f / "e.geojson", 900, 0, 950, 9), 0.5), "does not meet"),
        (lambda f: CoverFile(raster(f / "f.tif", np.ones((4, 4)), -20, 10, 5, crs=None), None), "CRS"),
    ],
)
def test_a_bad_layer_is_one_clear_line(tmp_path, make, said):
    with pytest.raises(InputError, match=said) as fault:
        with_cover(TERRAIN, [make(tmp_path)])
    assert "\n" not in str(fault.value)


def test_text_that_is_no_raster_and_no_polygon_is_refused(tmp_path):
    for name, hidden in (("x.tif", None), ("x.geojson", 0.4), ("x.kml", 0.4)):
        (tmp_path / name).write_text("hello")
        with pytest.raises(InputError, match=name):
            with_cover(TERRAIN, [CoverFile(tmp_path / name, hidden)])

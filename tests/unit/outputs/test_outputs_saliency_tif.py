from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
from pyproj import CRS

from pipeline.outputs.report import ReportData
from pipeline.outputs.saliency_tif import write_saliency

Search = Callable[..., ReportData]


def test_what_is_read_back_equals_the_map(search: Search, tmp_path: Path) -> None:
    voxel_map = search().voxel_map
    write_saliency(tmp_path / "saliency.tif", voxel_map)
    known = np.isfinite(voxel_map.terrain.heights_m)
    with rasterio.open(tmp_path / "saliency.tif") as source:
        bands = source.read()[:, ::-1]
        assert source.descriptions[:3] == ("probability", "log_odds", "observations")
        assert source.descriptions[3:] == ("looks", "resolution", "pod", "unseen_for")
        assert source.units == ("1", "nat", "count", "count", "pixels per person", "1", "s")
        assert set(source.dtypes) == {"float32"}
        assert np.isnan(source.nodata)
        assert CRS.from_user_input(source.crs) == voxel_map.terrain.frame.crs
        assert source.profile["tiled"]
        assert source.compression.name == "deflate"
    assert np.isnan(bands[:, ~known]).all()
    np.testing.assert_array_equal(bands[1][known], voxel_map.log_odds[known])
    np.testing.assert_array_equal(bands[2][known], voxel_map.observations[known])
    np.testing.assert_allclose(bands[0][known], 1 / (1 + np.exp(-voxel_map.log_odds[known])), rtol=1e-6)


def test_north_is_up_and_a_place_is_where_it_is(search: Search, tmp_path: Path) -> None:
    data = search()
    place = data.summary.locations[0]
    write_saliency(tmp_path / "saliency.tif", data.voxel_map)
    row, column = data.voxel_map.terrain.cells(place.position_enu[None])[0]
    with rasterio.open(tmp_path / "saliency.tif") as source:
        assert source.transform.e < 0
        (values,) = source.sample([tuple(place.position_enu[:2])])
        longitude, latitude = rasterio.warp.transform(source.crs, "EPSG:4326", *place.position_enu[:2, None])
    assert values[1] == data.voxel_map.log_odds[row, column]
    assert latitude[0] == pytest.approx(place.latitude_deg, abs=1e-8)
    assert longitude[0] == pytest.approx(place.longitude_deg, abs=1e-8)


def test_the_same_map_gives_the_same_bytes(search: Search, tmp_path: Path) -> None:
    write_saliency(tmp_path / "a.tif", search().voxel_map)
    write_saliency(tmp_path / "b.tif", search().voxel_map)
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()
    assert len(list(tmp_path.iterdir())) == 2

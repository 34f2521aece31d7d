from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
from pyproj import CRS
from synthetic_search import SIZE, START_NS, Size, map_of

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
    np.testing.assert_array_equal(bands[2][known], voxel_map.observations[known])
    looked = known & (voxel_map.observations > 0)
    np.testing.assert_array_equal(bands[1][looked], voxel_map.log_odds[looked])
    np.testing.assert_allclose(bands[0][looked], 1 / (1 + np.exp(-voxel_map.log_odds[looked])), rtol=1e-6)


def test_where_nobody_looked_there_is_no_data_and_where_somebody_did_one_half_is_a_value(
    tmp_path: Path,
) -> None:
    voxel_map = map_of(SIZE, np.zeros((0, 2)))
    rows, columns = np.array([8]), np.array([9])
    voxel_map.tiles.cells["log_odds"][voxel_map.tiles.flat(rows, columns)] = 0.0  # looked at, and undecided
    write_saliency(tmp_path / "saliency.tif", voxel_map)
    nobody = np.isfinite(voxel_map.terrain.heights_m) & (voxel_map.observations == 0)
    assert nobody.any()
    with rasterio.open(tmp_path / "saliency.tif") as source:
        bands = dict(zip(source.descriptions, source.read(masked=True)[:, ::-1], strict=True))
    for name in ("probability", "log_odds", "resolution", "pod", "unseen_for"):
        assert bands[name].mask[nobody].all(), name
    assert not bands["probability"].mask[8, 9]
    assert bands["probability"][8, 9] == 0.5
    for name in ("observations", "looks"):
        assert (bands[name][nobody] == 0.0).all()
        assert not bands[name].mask[nobody].any()


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


def test_the_layers_of_how_well_it_was_observed_are_read_back(tmp_path: Path) -> None:
    voxel_map = map_of(SIZE, np.zeros((0, 2)))
    cells = voxel_map.tiles.cells
    known = voxel_map.tiles.flat(np.array([5, 6]), np.array([7, 8]))
    cells["looks"][known], cells["resolution_px"][known], cells["pod_look"][known] = (2, 1), (640, 152), 0.25
    cells["pod_before"][known[0]] = 0.5
    cells["last_seen_ns"][known] = START_NS, START_NS + 2_500_000_000
    write_saliency(tmp_path / "saliency.tif", voxel_map)
    with rasterio.open(tmp_path / "saliency.tif") as source:
        bands = source.read()[3:, ::-1]
    np.testing.assert_allclose(bands[:, 5, 7], [2.0, 40.0, 1.0 - 0.5 * 0.75, 2.5])
    np.testing.assert_allclose(bands[:, 6, 8], [1.0, 9.5, 0.25, 0.0])
    np.testing.assert_array_equal(bands[:, 10, 10], [0.0, 0.0, 0.0, np.nan])


def test_of_a_very_large_map_only_what_was_looked_at_is_written(
    search: Search, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    voxel_map = map_of(Size(300, 600), np.zeros((0, 2)))
    write_saliency(tmp_path / "whole.tif", voxel_map)
    voxel_map.tiles.clear()
    voxel_map.update(np.array([270]), np.array([300]), np.array([1.0]))
    monkeypatch.setattr("pipeline.outputs.saliency_tif.MOST_CELLS", 1000)
    write_saliency(tmp_path / "part.tif", voxel_map)
    with rasterio.open(tmp_path / "whole.tif") as whole, rasterio.open(tmp_path / "part.tif") as part:
        assert whole.shape == (300, 600)
        assert part.shape == (300 - 256, 256)
        east, north = voxel_map.terrain.centers(np.array([270]), np.array([300]))[0, :2]
        assert next(part.sample([(east, north)]))[1] == 1.0

"""Positions with latitude and longitude exchanged are refused with what would mend them; others are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from pipeline.errors import InputError
from pipeline.ingest.checks.exchanged_axes import require_axes_in_order
from pipeline.ingest.telemetry.dji_srt import read_dji_srt
from pipeline.ingest.track import Track

PLACES = [(58.4, 15.6), (47.0, 8.0), (-33.4, -70.6), (12.0, 45.0)]


def model(path: Path, latitude: float, longitude: float) -> Path:
    profile = {
        "driver": "GTiff", "width": 40, "height": 40, "count": 1, "dtype": "float32", "crs": "EPSG:4326",
        "transform": from_origin(longitude - 0.01, latitude + 0.01, 0.0005, 0.0005),
    }  # fmt: skip
    with rasterio.open(path, "w", **profile) as file:
        file.write(np.full((1, 40, 40), 100.0, np.float32))
    return path


def track(latitude: float, longitude: float) -> Track:
    n = np.linspace(-0.002, 0.002, 20)
    one = np.ones(20)
    return Track(0, np.arange(20.0), latitude + n, longitude + n, one, one, one, one, one, "utc")


@pytest.mark.parametrize(("latitude", "longitude"), PLACES)
def test_exchanged_axes_are_named(tmp_path: Path, latitude: float, longitude: float) -> None:
    files = [model(tmp_path / "far.tif", 10.0, 100.0), model(tmp_path / "dem.tif", latitude, longitude)]
    require_axes_in_order("a.srt", track(latitude, longitude), files)
    with pytest.raises(InputError, match="exchanged they lie on it") as refused:
        require_axes_in_order("a.srt", track(longitude, latitude), files)
    assert "telemetry.gps_order" in str(refused.value)
    assert "telemetry.columns" in str(refused.value)


def test_a_flight_elsewhere_is_not_that_fault_and_one_beside_the_model_is_none(tmp_path: Path) -> None:
    files = [model(tmp_path / "dem.tif", 47.0, 8.0)]
    for place in ((47.0, 9.0), (8.0, 9.0), (47.02, 8.0), (50.0, 120.0)):
        require_axes_in_order("a.srt", track(*place), files)
    require_axes_in_order("a.srt", track(8.0, 47.0), [])
    # where both are nearly the same number, both are on the model
    require_axes_in_order("a.srt", track(45.0, 45.005), [model(tmp_path / "both.tif", 45.0, 45.0)])


def test_latitudes_that_cannot_be_say_what_they_may_be(tmp_path: Path) -> None:
    path = tmp_path / "a.srt"
    cues = [
        f"{k}\n00:00:0{k},000 --> 00:00:0{k},900\n[latitude: -105.27{k}] [longitude: 40.01] [rel_alt: 20.0]\n"
        for k in range(1, 6)
    ]
    path.write_text("\n".join(cues), encoding="utf-8")
    with pytest.raises(InputError, match="are latitude and longitude exchanged"):
        read_dji_srt(path)

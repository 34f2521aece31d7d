"""GoPro's GPMF: positions to their values, no fix left out, no angles made up."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.registry import format_of, read_telemetry
from pipeline.ingest.track import Track
from tests.dialects import gpmf
from tests.dialects.tracks import START_NS, flight

SHARED = Path(__file__).parents[4] / "shared/data/telemetry"
WHEN = datetime(2026, 6, 14, 9, 30, tzinfo=UTC)
ROWS = [(58.4, 15.57, 120.0)] * 10


def read(path: Path, **kept: Any) -> Track:
    return read_telemetry(Telemetry(file=path, **kept))


@pytest.mark.parametrize("kind", ["GPS5", "GPS9"])
def test_what_was_laid_in_comes_out(tmp_path: Path, kind: str) -> None:
    path, true = tmp_path / "flight.raw", flight()
    gpmf.write(path, true, kind)
    track = read(path)
    assert format_of(Telemetry(file=path)).name == "gopro-gpmf"
    assert np.allclose(track.latitude_deg, true.latitude_deg, atol=6e-8)
    assert np.allclose(track.longitude_deg, true.longitude_deg, atol=6e-8)
    assert np.allclose(track.absolute_height_m, true.absolute_height_m, atol=6e-4)
    assert np.allclose(track.times_s, true.times_s, atol=7e-3)  # 1.001 s each
    assert track.tied_to_video
    assert track.clock == "utc"
    assert abs(track.start_time_ns - START_NS) < 2_000_000
    assert track.camera_name == "Hero11 Black"
    assert np.isnan(track.yaw_rad).all()
    assert track.horizontal_sd_m is not None
    assert track.height_datum == ("geoid" if kind == "GPS5" else None)


def test_in_an_mp4_the_track_is_tied_to_the_pictures(tmp_path: Path) -> None:
    path, true = tmp_path / "GX010001.MP4", flight()
    stamps = [datetime.fromtimestamp(START_NS * 1e-9 + k, UTC) for k in range(6)]
    gpmf.write_video(
        path, [gpmf.payload(gpmf.gps5(gpmf.positions(true, k, 10), when)) for k, when in enumerate(stamps)]
    )
    assert format_of(Telemetry(file=path)).name == "gopro-gpmf"
    track = read(path)
    assert np.allclose(track.times_s, true.times_s, atol=2e-3)
    assert np.allclose(track.latitude_deg, true.latitude_deg, atol=6e-8)
    assert track.tied_to_video
    assert not track.assumed


def test_an_mp4_without_a_track_of_telemetry_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "GX010001.MP4"
    gpmf.write_video(path, [b"no GPMF in here"])
    with pytest.raises(InputError, match="without GPS"):
        read(path)


def test_a_second_without_a_fix_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "flight.raw"
    path.write_bytes(
        gpmf.payload(gpmf.gps5(ROWS, WHEN))
        + gpmf.payload(gpmf.gps5(ROWS, WHEN, fix=0))
        + gpmf.payload(gpmf.gps5(ROWS, WHEN, fix=2))
    )
    track = read(path)
    assert track.left_out == {"no_fix": 20}
    assert len(track.times_s) == 10


@pytest.mark.parametrize("share", [0.4, 0.75])
def test_a_file_cut_off_gives_its_whole_payloads(tmp_path: Path, share: float) -> None:
    path = tmp_path / "flight.raw"
    gpmf.write(path, flight())
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    assert len(read(path).times_s) == 10 * int(share * 6)


def test_numbers_that_do_not_fit_their_description_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "flight.raw"
    wrong = gpmf.nest(
        "STRM", gpmf.item("SCAL", "l", 4, 5, bytes(20)), gpmf.item("GPS5", "l", 18, 2, bytes(36))
    )
    zero = gpmf.nest(
        "STRM", gpmf.item("SCAL", "l", 4, 5, bytes(20)), gpmf.item("GPS5", "l", 20, 2, bytes(40))
    )
    path.write_bytes(gpmf.payload(wrong) + gpmf.payload(gpmf.gps5(ROWS, WHEN)) + gpmf.payload(zero))
    track = read(path)
    assert track.left_out["unreadable"] == 3
    assert len(track.times_s) == 10


@pytest.mark.parametrize(
    "data",
    [
        gpmf.payload(gpmf.nest("STRM", gpmf.item("ACCL", "s", 6, 2, bytes(12)))),
        b"DEVC",
        b"DEVC\0\xff\xff\xff" + bytes(200),
    ],
)
def test_a_file_without_positions_is_refused_in_one_line(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "flight.raw"
    path.write_bytes(data)
    with pytest.raises(InputError) as error:
        read(path)
    assert "\n" not in str(error.value)


@pytest.mark.skipif(not SHARED.exists(), reason="no ../shared beside the repository")
def test_the_track_of_a_gopro_in_its_mp4() -> None:
    track = read(SHARED / "gopro_max_heromode.mp4")
    assert len(track.times_s) == 191
    assert track.latitude_deg[0] == pytest.approx(33.12677, abs=1e-6)
    assert track.longitude_deg[0] == pytest.approx(-117.3273436, abs=1e-6)
    assert track.camera_name == "GoPro Max"
    assert track.tied_to_video


@pytest.mark.skipif(not SHARED.exists(), reason="no ../shared beside the repository")
def test_a_gopro_without_a_lock_is_read_and_none_of_it_is_a_position() -> None:
    track = read(SHARED / "gopro_hero6_gpmf.raw")
    assert track.latitude_deg[[0, 1]].tolist() == [33.1265542, 33.1265547]
    assert track.longitude_deg[[0, 1]].tolist() == [-117.3271299, -117.3271292]
    assert track.absolute_height_m[0] == -18.172
    assert datetime.fromtimestamp(track.start_time_ns // 1e9, UTC) == datetime(
        2018, 1, 24, 19, 28, 1, tzinfo=UTC
    )
    assert dict(track.left_out) == {"no_fix": len(track.times_s)} == {"no_fix": 17}
    assert not track.has_position.any()

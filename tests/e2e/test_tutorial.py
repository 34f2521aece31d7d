"""docs/tutorial.md, followed as it stands: a drone's files in, a map out, then with a detector of one's own."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import av
import numpy as np
import pytest
import rasterio

from pipeline.geo.frame import LocalFrame
from pipeline.ingest.track import Track
from tests.dialects import demo, dji_subtitles, yolov8_onnx

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 4.0
#: what the elevation model's heights are rounded to, metres
STEP_M = 0.01


def commands() -> list[str]:
    """The blocks that are to be typed, but the one that installs: this Python has everything already."""
    text = (ROOT / "docs/tutorial.md").read_text(encoding="utf-8")
    return re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def write_video(path: Path) -> None:
    """The first seconds of what the demo's first drone filmed, in a file of another make."""
    with av.open(str(demo.DEMO / "drone-1.mp4")) as read, av.open(str(path), "w", format="mp4") as written:
        video = read.streams.video[0]
        stream = written.add_stream_from_template(video)
        for packet in read.demux(video):
            if packet.pts is not None and packet.time_base and packet.pts * packet.time_base < SECONDS:
                packet.stream = stream
                written.mux(packet)


def first_seconds(track: Track) -> Track:
    kept = track.times_s < SECONDS
    arrays = {
        f.name: value[kept]
        for f in fields(track)
        if isinstance(value := getattr(track, f.name), np.ndarray) and len(value) == len(kept)
    }
    return replace(track, **arrays, end_s=None)


def without_focal_length(rows: Track, i: int) -> str:
    """As some drones write: nothing in the files tells the camera."""
    return dji_subtitles.brackets(rows, i).replace("[focal_len : 240] ", "")


def write_elevation_model(path: Path) -> None:
    """Whole numbers with scale and offset, in degrees of latitude and longitude, as agencies give them."""
    with rasterio.open(demo.DEMO / "terrain.tif") as source:
        from rasterio.warp import Resampling, calculate_default_transform, reproject

        crs = "EPSG:4326"
        transform, width, height = calculate_default_transform(
            source.crs, crs, source.width, source.height, *source.bounds
        )
        heights_m = np.full((height, width), np.nan, np.float32)
        reproject(
            rasterio.band(source, 1), heights_m, dst_transform=transform, dst_crs=crs,
            dst_nodata=np.nan, resampling=Resampling.bilinear,
        )  # fmt: skip
    whole = np.where(np.isnan(heights_m), -32768, np.round((heights_m - 100.0) / STEP_M)).astype(np.int16)
    with rasterio.open(
        path, "w", driver="GTiff", width=width, height=height, count=1, dtype="int16", crs=crs,
        transform=transform, nodata=-32768, compress="deflate",
    ) as target:  # fmt: skip
        target.write(whole, 1)
        target.scales, target.offsets = (STEP_M,), (100.0,)


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    """A folder with ``flight`` and ``mine.onnx``, and the command ``searchlight`` of this checkout."""
    flight = tmp_path / "flight"
    flight.mkdir()
    write_video(flight / "DJI_0001.MP4")
    rows = first_seconds(demo.at_rate(demo.true_track("drone-1"), 10.0))
    dji_subtitles.write(flight / "DJI_0001.SRT", rows, without_focal_length, line_end="\r\n")
    write_elevation_model(flight / "dem.tif")
    yolov8_onnx.write(tmp_path / "mine.onnx", ROOT / "configs/detectors/small.onnx")
    command = tmp_path / "bin/searchlight"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" -m actors "$@"\n')
    command.chmod(0o755)
    return tmp_path


def off_m(place: dict[str, float], people: list[dict[str, list[float]]]) -> float:
    """From a place to the nearest true person."""
    frame = LocalFrame(place["latitude_deg"], place["longitude_deg"])
    longitude, latitude, *_ = np.array([p["coordinates"] for p in people]).T
    return float(np.hypot(*frame.enu_from_wgs84(latitude, longitude)).min())


@pytest.mark.slow
@pytest.mark.timeout(600)  # half a minute on two idle cores
def test_the_tutorial_works_as_it_stands(desk: Path) -> None:
    said = []
    for block in commands():
        result = subprocess.run(
            ["bash", "-e", "-c", block], cwd=desk, capture_output=True, text=True, check=False,
            env=os.environ | {"PATH": f"{desk / 'bin'}:{os.environ['PATH']}"},
        )  # fmt: skip
        assert result.returncode == 0, f"{block}\n{result.stdout}\n{result.stderr}"
        said.append(result.stdout + result.stderr)
    init, _, check, _, inspect, _, add, _ = said
    assert "to fill in" in init
    assert "FILL IN" in init
    assert "field_of_view" in init
    assert "usable" in check
    assert "planned: DJI_0001" in check
    assert inspect.startswith("mine.onnx: yolov8\n")
    assert "assumed" in add
    truth = json.loads((demo.DEMO / "truth/people.geojson").read_text(encoding="utf-8"))["features"]
    people = [person["geometry"] for person in truth]
    for run, detectors in (("run", {"nano", "small", "medium", "large"}), ("run-mine", {"mine"})):
        summary = json.loads((desk / "flight" / run / "summary.json").read_text(encoding="utf-8"))
        assert summary["found"], run
        assert all(off_m(place, people) < 2.0 for place in summary["found"]), run
        plan = json.loads((desk / "flight" / run / "plan.json").read_text(encoding="utf-8"))
        assert {a["pool_detector"] for a in plan["plan"]["assignments"]} <= detectors
        assert (desk / "flight" / run / "report.html").is_file()
    assert (desk / "boxes.mp4").is_file()


def test_every_file_that_the_tutorial_points_to_is_there() -> None:
    text = (ROOT / "docs/tutorial.md").read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)", text):
        assert (ROOT / "docs" / target).is_file(), target
    assert (ROOT / "configs/missions/demo/terrain.tif").is_file()

"""Whole runs on video as it comes off a card: damaged, in several files, cut to a part."""

from __future__ import annotations

import json
import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from typer.testing import CliRunner

from actors.cli import app
from pipeline.config.telemetry import Telemetry
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.video.recordings import open_recordings
from tests.stills import write_still
from tests.videos import packet_places


@pytest.fixture
def folder(small_mission: Path, tmp_path: Path) -> Path:
    shutil.copytree(small_mission.parent, tmp_path / "mission")
    return tmp_path / "mission"


def run(folder: Path) -> dict[str, Any]:
    out = folder / "out"
    result = CliRunner().invoke(app, ["run", str(folder / "mission.yaml"), "--local", "--out", str(out)])
    assert result.exit_code == 0, result.output
    summary: dict[str, Any] = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    for stream in summary["streams"]:
        assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values())
    return summary


def in_mission(folder: Path, old: str, new: str) -> None:
    mission = folder / "mission.yaml"
    text = mission.read_text(encoding="utf-8")
    assert old in text
    mission.write_text(text.replace(old, new), encoding="utf-8")


def test_damaged_pictures_are_counted_and_the_flight_is_used(folder: Path) -> None:
    video = folder / "drone-1.mp4"
    data = bytearray(video.read_bytes())
    for start, size, _ in packet_places(video)[10:40:10]:
        data[start : start + size] = bytes(0xFF for _ in range(size))
    video.write_bytes(data)
    first, second = run(folder)["streams"]
    assert first["dropped"]["damaged"] >= 2
    assert "damaged" not in second["dropped"]
    assert first["processed"] > 0


@pytest.mark.slow
def test_a_recording_in_two_files_is_one_flight(folder: Path) -> None:
    whole = folder / "drone-1.mp4"
    with av.open(str(whole)) as old:
        template = old.streams.video[0]
        packets = [p for p in old.demux(template) if p.size]
        half = [k for k, p in enumerate(packets) if p.is_keyframe][1]
        for name, part in (("part-1.mp4", packets[:half]), ("part-2.mp4", packets[half:])):
            with av.open(str(folder / name), "w") as new:
                stream = new.add_stream_from_template(template)
                shift = min(p.pts for p in part)
                for packet in part:
                    packet.pts, packet.dts, packet.stream = packet.pts - shift, packet.dts - shift, stream
                    new.mux(packet)
    expected = run(folder)
    shutil.rmtree(folder / "out")
    in_mission(folder, "video: drone-1.mp4", "video: [part-1.mp4, part-2.mp4]")
    summary = run(folder)
    assert summary["streams"] == expected["streams"]
    assert len(summary["truth"]["found"]) == len(expected["truth"]["found"])
    assert any(f["cause"] == "recordings" for f in summary["findings"])


@pytest.mark.slow
def test_a_part_of_a_flight_can_be_used(folder: Path) -> None:
    in_mission(
        folder, "video: drone-1.mp4", "video: drone-1.mp4\n  start: {seconds: 1.0}\n  end: {seconds: 2.0}"
    )
    first, second = run(folder)["streams"]
    assert first["captured"] == 30
    assert second["captured"] > 30


def test_a_folder_of_stills_is_a_flight(folder: Path) -> None:
    track = read_telemetry(Telemetry(file=folder / "drone-1.srt"))
    stills = folder / "stills"
    stills.mkdir()
    start = datetime.fromtimestamp(track.start_time_ns // 10**9, UTC).replace(tzinfo=None)
    source = open_recordings([folder / "drone-1.mp4"])
    times_s = source.times_s[::10]
    for k, (time_s, image) in enumerate(source.images_at(times_s.tolist())):
        at = 10 * k
        xmp = {
            "AbsoluteAltitude": f"{track.absolute_height_m[at]:+.3f}",
            "GimbalYawDegree": f"{np.degrees(track.yaw_rad[at]):+.4f}",
            "GimbalPitchDegree": f"{np.degrees(track.pitch_rad[at]):+.4f}",
            "GimbalRollDegree": "+0.00",
        }
        place = float(track.latitude_deg[at]), float(track.longitude_deg[at])
        taken = start + timedelta(seconds=float(time_s))
        write_still(stills / f"DJI_{k:04}.JPG", image, taken, *place, 0.0, xmp, offset="+00:00")
    mission = folder / "mission.yaml"
    lines = mission.read_text(encoding="utf-8").split("- id: drone-2")
    begin = lines[0].index("  video: drone-1.mp4")
    kept = lines[0][:begin] + "  stills: stills\n  camera: camera.yaml\n  site: drone-1\n"
    mission.write_text(kept + "- id: drone-2" + lines[1], encoding="utf-8")
    (stills / "DJI_0002.JPG").write_bytes((stills / "DJI_0002.JPG").read_bytes()[:-3000])
    first, _ = run(folder)["streams"]
    assert first["captured"] == len(times_s)
    assert first["processed"] == len(times_s) - 1
    assert first["dropped"] == {"damaged": 1}

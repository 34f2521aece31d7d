"""Whole runs on video as it comes off a card: damaged, in several files, cut to a part."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import av
import pytest
from typer.testing import CliRunner

from actors.cli import app
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

"""The demo's true tracks in the dialects of DJI's subtitles: its poses and people, as surely as each can tell."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from pipeline.config.mission import load_mission
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory import Trajectory
from pipeline.mission.faults import Faults
from pipeline.mission.prepared import read_filmed
from tests.dialects import demo, dji_subtitles, video_text_track

ROOT = Path(__file__).resolve().parents[2]
#: squared distance in standard deviations within which 95 % of a plane's normal distribution lies
WITHIN_95 = 5.991
ABSOLUTE = {"height": "absolute", "height_datum": "ellipsoid"}
LOCAL_UTC = {"utc_offset": {"hours": 0}}
DOWN = {"gimbal": {"pitch": {"degrees": -45}, "yaw": "course"}}


@dataclass(frozen=True)
class Dialect:
    """How a track is written and what the mission then says of it. relative: heights above take-off.

    rate_hz: samples that are written. fine: the dialect tells all that the demo needs. off_m: the most that a
    position or a height may be off by the decimals and by the time between two samples.
    """

    write: Callable[[Path, Track], None]
    suffix: str = ".srt"
    rate_hz: float = 30.0
    relative: bool = False
    fine: bool = True
    off_m: float = 0.03
    says: Mapping[str, Any] = field(default_factory=dict)

    def telemetry(self, folder: Path, stream: str) -> dict[str, Any]:
        """Write a stream's file; what stands under ``telemetry``."""
        true, path = demo.true_track(stream), folder / f"{stream}{self.suffix}"
        self.write(path, demo.at_rate(true, self.rate_hz) if self.rate_hz < 30.0 else true)
        above = {"height": "relative", "takeoff_height": {"meters": demo.takeoff_height_m(true)}}
        return {"file": str(path), **(above if self.relative else ABSOLUTE), **self.says}


def subtitles(text: dji_subtitles.Text, **how: Any) -> Callable[[Path, Track], None]:
    return lambda path, rows: dji_subtitles.write(path, rows, text, **how)


def in_video(text: dji_subtitles.Text) -> Callable[[Path, Track], None]:
    return lambda path, rows: video_text_track.write(path, demo.DEMO / f"{path.stem}.mp4", rows, text)


DIALECTS = {
    "brackets, UTF-16": Dialect(subtitles(dji_subtitles.brackets, encoding="utf-16"), says=LOCAL_UTC),
    "brackets, Windows line ends, 5 Hz": Dialect(
        subtitles(dji_subtitles.brackets, line_end="\r\n"), rate_hz=5.0, says=LOCAL_UTC
    ),
    "G.PRY": Dialect(subtitles(dji_subtitles.pitch_roll_yaw), relative=True),
    "RTK, Latin-1": Dialect(subtitles(dji_subtitles.rtk, encoding="latin-1"), relative=True),
    "text track in MP4": Dialect(
        in_video(dji_subtitles.brackets), suffix=".mp4", says=LOCAL_UTC
    ),
    "text track in Matroska, 10 Hz": Dialect(
        in_video(dji_subtitles.brackets), suffix=".mkv", rate_hz=10.0, says=LOCAL_UTC
    ),
    "brackets, 1 Hz": Dialect(subtitles(dji_subtitles.brackets), rate_hz=1.0, fine=False, off_m=0.3, says=LOCAL_UTC),
    "BAROMETER, 1 Hz, fixed gimbal": Dialect(
        subtitles(dji_subtitles.barometer), rate_hz=1.0, relative=True, fine=False, off_m=6.0,
        says=LOCAL_UTC | DOWN
    ),
    "whole metres and degrees, 1 Hz": Dialect(
        subtitles(dji_subtitles.whole_metres), rate_hz=1.0, relative=True, fine=False, off_m=6.0
    ),
}  # fmt: skip


def run(mission: Path, out: Path) -> dict[str, Any]:
    command = [sys.executable, "-m", "actors.cli", "run", str(mission), "--out", str(out), "--local"]
    subprocess.run(command, cwd=ROOT, check=True)
    return dict(json.loads((out / "summary.json").read_text(encoding="utf-8")))


def located(summary: Mapping[str, Any]) -> int:
    """How many of the people lie inside the 95 % ellipse of a found place of their own."""
    people = json.loads((demo.DEMO / "truth/people.geojson").read_text(encoding="utf-8"))["features"]
    longitude, latitude, _ = np.array([p["geometry"]["coordinates"] for p in people]).T
    holds = np.zeros((len(summary["found"]), len(people)))
    for row, place in enumerate(summary["found"]):
        frame = LocalFrame(place["latitude_deg"], place["longitude_deg"])
        off = np.stack(frame.enu_from_wgs84(latitude, longitude))
        ee, en, nn = place["error_ellipse"]["covariance_m2"]
        holds[row] = (off * np.linalg.solve([[ee, en], [en, nn]], off)).sum(axis=0) <= WITHIN_95
    return int(holds[linear_sum_assignment(-holds)].sum())


def trajectories(mission: Path) -> list[Trajectory]:
    return [s.trajectory for s in read_filmed(mission, load_mission(mission), Faults()).streams]


@pytest.fixture(scope="module")
def true() -> list[Trajectory]:
    return trajectories(demo.DEMO / "mission.yaml")


@pytest.mark.parametrize("name", DIALECTS)
def test_a_dialect_gives_the_demos_poses_to_its_resolution(
    tmp_path: Path, true: list[Trajectory], name: str
) -> None:
    dialect = DIALECTS[name]
    telemetry = {stream: dialect.telemetry(tmp_path, stream) for stream in demo.STREAMS}
    for one, other in zip(trajectories(demo.mission_with(tmp_path, telemetry)), true, strict=True):
        for time_s in np.arange(0.0, 46.7, 0.7):
            ours, theirs = one.pose(float(time_s)), other.pose(float(time_s))
            assert ours is not None
            assert theirs is not None
            off_m = np.abs(ours.position_enu - theirs.position_enu)
            assert off_m.max() <= dialect.off_m
            if off_m[:2].max() > 2.0:
                assert off_m[:2].max() < 3.0 * ours.horizontal_sd_m
            if dialect.fine:
                assert np.abs(ours.enu_from_camera - theirs.enu_from_camera).max() < 0.01


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", DIALECTS)
def test_a_dialect_finds_what_it_can_resolve(tmp_path: Path, name: str) -> None:
    dialect = DIALECTS[name]
    telemetry = {stream: dialect.telemetry(tmp_path, stream) for stream in demo.STREAMS}
    summary = run(demo.mission_with(tmp_path, telemetry), tmp_path / "run")
    truth = summary["truth"]
    print(json.dumps({"dialect": name, "found": len(truth["found"]), "false": len(truth["false"]),
                      "error_m": truth["mean_distance_m"], "located": located(summary)}))  # fmt: skip
    if dialect.fine:
        assert (len(truth["found"]), truth["missed"], truth["false"]) == (9, [], [])
        return
    said = any(f["cause"] == "resolution" and f["severity"] == "warning" for f in summary["findings"])
    assert said or (located(summary) >= 8 and not truth["false"])

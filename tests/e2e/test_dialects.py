"""The demo's true tracks in the dialects of drones, apps and loggers: the same people, as surely as each can tell."""

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

from pipeline.geo.frame import LocalFrame
from pipeline.ingest.track import Track
from tests.dialects import (
    airdata_csv,
    column_table,
    demo,
    dji_flight_record_csv,
    dji_subtitles,
    litchi_csv,
    video_text_track,
)

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
ROOT = Path(__file__).resolve().parents[2]
#: squared distance in standard deviations within which 95 % of a plane's normal distribution lies
WITHIN_95 = 5.991
ABSOLUTE = {"height": "absolute", "height_datum": "ellipsoid"}
LOCAL_UTC = {"utc_offset": {"hours": 0}}
DOWN = {"gimbal": {"pitch": {"degrees": -45}, "yaw": "course"}}


@dataclass(frozen=True)
class Dialect:
    """How a track is written and what the mission then says of it. relative: heights above take-off.

    rate_hz: samples that are written. fine: the dialect tells all that the demo needs.
    """

    write: Callable[[Path, Track], None]
    suffix: str = ".srt"
    rate_hz: float = 30.0
    relative: bool = False
    fine: bool = True
    says: Mapping[str, Any] = field(default_factory=dict)

    def telemetry(self, folder: Path, stream: str) -> dict[str, Any]:
        """Write a stream's file; what stands under ``telemetry``."""
        true, path = demo.true_track(stream), folder / f"{stream}{self.suffix}"
        self.write(path, demo.at_rate(true, self.rate_hz) if self.rate_hz < 30.0 else true)
        above = {"height": "relative", "takeoff_height": {"meters": demo.takeoff_height_m(true)}}
        return {"file": str(path), **(above if self.relative else ABSOLUTE), **self.says}


def subtitles(text: dji_subtitles.Text, **how: Any) -> Callable[[Path, Track], None]:
    return lambda path, rows: dji_subtitles.write(path, rows, text, **how)


def in_video(stream_of: Callable[[Path], str], text: dji_subtitles.Text) -> Callable[[Path, Track], None]:
    return lambda path, rows: video_text_track.write(path, demo.DEMO / f"{stream_of(path)}.mp4", rows, text)


FROM_ZERO = {"time_offset": {"seconds": 0}}
DIALECTS = {
    "brackets, UTF-16": Dialect(subtitles(dji_subtitles.brackets, encoding="utf-16"), says=LOCAL_UTC),
    "brackets, Windows line ends, 5 Hz": Dialect(
        subtitles(dji_subtitles.brackets, line_end="\r\n"), rate_hz=5.0, says=LOCAL_UTC
    ),
    "G.PRY": Dialect(subtitles(dji_subtitles.pitch_roll_yaw), relative=True),
    "RTK, Latin-1": Dialect(subtitles(dji_subtitles.rtk, encoding="latin-1"), relative=True),
    "text track in MP4": Dialect(
        in_video(lambda path: path.stem, dji_subtitles.brackets), suffix=".mp4", says=LOCAL_UTC
    ),
    "text track in Matroska, 10 Hz": Dialect(
        in_video(lambda path: path.stem, dji_subtitles.brackets), suffix=".mkv", rate_hz=10.0, says=LOCAL_UTC
    ),
    "Airdata in metres": Dialect(
        lambda path, rows: airdata_csv.write(path, rows, unit="meters", first_ms=0),
        suffix=".csv", rate_hz=10.0, says=FROM_ZERO,
    ),
    "Litchi": Dialect(
        lambda path, rows: litchi_csv.write(path, rows, first_ms=0),
        suffix=".csv", rate_hz=10.0, relative=True, says=FROM_ZERO,
    ),
    "decoded flight record": Dialect(
        lambda path, rows: dji_flight_record_csv.write(path, rows, tool="dji-log-parser"),
        suffix=".csv", rate_hz=10.0, says=FROM_ZERO,
    ),
    "a table of one's own": Dialect(
        column_table.write, suffix=".csv", rate_hz=10.0, says=FROM_ZERO | {"columns": column_table.COLUMNS}
    ),
    "brackets, 1 Hz": Dialect(subtitles(dji_subtitles.brackets), rate_hz=1.0, fine=False, says=LOCAL_UTC),
    "BAROMETER, 1 Hz, fixed gimbal": Dialect(
        subtitles(dji_subtitles.barometer), rate_hz=1.0, relative=True, fine=False, says=LOCAL_UTC | DOWN
    ),
    "whole metres and degrees, 1 Hz": Dialect(
        subtitles(dji_subtitles.whole_metres), rate_hz=1.0, relative=True, fine=False
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

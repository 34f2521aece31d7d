"""What a run directory says of ground that nobody looked at, and from where its second flight counts heights."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from lxml import etree

from pipeline.geo.frame import LocalFrame
from pipeline.ingest.finding import Finding
from pipeline.logs import logged_run
from pipeline.mission import run_directory
from pipeline.mission.local import FinishedRun, run_local
from pipeline.mission.planning import plan
from pipeline.mission.prepared import PreparedMission, prepare
from pipeline.mission.run_directory import write_run_directory


@pytest.fixture(scope="module")
def prepared(small_mission: Path) -> PreparedMission:
    return prepare(small_mission)


@pytest.fixture(scope="module")
def finished(prepared: PreparedMission) -> FinishedRun:
    return run_local(prepared, plan(prepared), lambda *_: None)


def flown(prepared: PreparedMission, **changes: Any) -> PreparedMission:
    """The mission with other trajectories."""
    streams = [replace(s, trajectory=replace(s.trajectory, **changes)) for s in prepared.streams]
    return replace(prepared, streams=tuple(streams))


def along(prepared: PreparedMission, length_m: float, sd_m: float) -> PreparedMission:
    """All drones on one straight leg, their positions wandering about it."""
    positions = prepared.streams[0].trajectory.positions_enu.copy()
    positions[:, 0] = np.linspace(-length_m / 2.0, length_m / 2.0, len(positions))
    positions[:, 1] = 0.3 * positions[:, 0]
    positions[:, :2] += np.random.default_rng(3).normal(0.0, sd_m, (len(positions), 2))
    return flown(prepared, positions_enu=positions, times_s=prepared.streams[0].trajectory.times_s)


def area(path: Path, frame: LocalFrame, west: float, south: float, east: float, north: float) -> Path:
    corners = np.array([[west, south], [east, south], [east, north], [west, north], [west, south]])
    latitude, longitude = frame.wgs84_from_enu(corners[:, 0], corners[:, 1])
    ring = np.stack([longitude, latitude], axis=1).tolist()
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    return path


def searched(prepared: PreparedMission, path: Path) -> PreparedMission:
    return replace(prepared, mission=prepared.mission.model_copy(update={"search_area": path}))


@pytest.mark.parametrize(("length_m", "sd_m"), [(60.0, 0.5), (0.0, 0.0), (0.0, 1.0)])
def test_a_straight_leg_and_a_hover_are_not_judged(
    prepared: PreparedMission, finished: FinishedRun, tmp_path: Path, length_m: float, sd_m: float
) -> None:
    summary = write_run_directory(along(prepared, length_m, sd_m), finished, tmp_path / "run")
    assert "Not judged" in summary.verdict.sentence
    content = json.loads((tmp_path / "run/summary.json").read_text())
    assert content["coverage"]["basis"] == "none"
    report = (tmp_path / "run/report.html").read_text()
    assert "Not judged" in report
    assert "decided" not in report
    assert not (tmp_path / "run/second_flight.plan").exists()


def test_of_a_search_area_it_is_said_what_nobody_looked_at_and_what_was_not_judged(
    prepared: PreparedMission, finished: FinishedRun, tmp_path: Path
) -> None:
    terrain = prepared.terrain
    east_m = terrain.east_m + terrain.shape[1] * terrain.cell_m
    path = area(tmp_path / "a.geojson", prepared.frame, east_m - 40.0, -10.0, east_m + 60.0, 10.0)
    write_run_directory(searched(prepared, path), finished, tmp_path / "run")
    coverage = json.loads((tmp_path / "run/summary.json").read_text())["coverage"]
    assert coverage["wanted_m2"] == pytest.approx(2000.0, rel=1e-3)
    assert coverage["not_judged_m2"] == pytest.approx(1200.0, abs=25.0)
    assert coverage["nobody_looked_m2"] + coverage["looked_at_m2"] == pytest.approx(coverage["judged_m2"])
    verdict = json.loads((tmp_path / "run/summary.json").read_text())["verdict"]["sentence"]
    assert f"Not judged: {coverage['not_judged_m2']:,.0f} of 2,0" in verdict
    assert "Nobody looked at" in verdict


def test_the_ground_that_nobody_looked_at_is_no_data(
    prepared: PreparedMission, finished: FinishedRun, tmp_path: Path
) -> None:
    write_run_directory(prepared, finished, tmp_path / "run")
    with rasterio.open(tmp_path / "run/saliency.tif") as source:
        probability, _, observations = source.read([1, 2, 3], masked=True)
    assert (probability.mask == (observations.filled(0) == 0)).all()
    assert probability.mask.any()
    assert not probability.mask.all()


@pytest.mark.parametrize("lower_m", [0.0, 20.0, -8.0])
def test_the_second_flight_counts_its_heights_from_the_takeoff(
    prepared: PreparedMission, finished: FinishedRun, tmp_path: Path, lower_m: float
) -> None:
    takeoff_m = prepared.streams[0].trajectory.takeoff_m - lower_m
    path = area(tmp_path / "a.geojson", prepared.frame, -25.0, -25.0, 25.0, 25.0)
    mission = searched(flown(prepared, takeoff_m=takeoff_m), path)
    write_run_directory(mission, finished, tmp_path / "run")
    (line,) = json.loads((tmp_path / "run/second_flight.geojson").read_text())["features"]
    above_ellipsoid = [point[2] for point in line["geometry"]["coordinates"][1:-1]]
    plan_file = json.loads((tmp_path / "run/second_flight.plan").read_text())
    qgc = [i["params"][6] for i in plan_file["mission"]["items"] if i["command"] == 16]
    assert qgc == pytest.approx([h - takeoff_m for h in above_ellipsoid], abs=0.02)
    with zipfile.ZipFile(tmp_path / "run/second_flight.kmz") as archive:
        waylines = etree.fromstring(archive.read("wpmz/waylines.wpml"))
    dji = [float(e.text) for e in waylines.iter("{http://www.dji.com/wpmz/1.0.2}executeHeight")]
    assert dji == pytest.approx(qgc, abs=0.02)
    least_m = line["properties"]["least_height_above_surface_m"]
    assert least_m >= prepared.mission.fusion.second_look.height - 0.02
    report = (tmp_path / "run/report.html").read_text()
    assert (f"{abs(lower_m):.0f} m below the ground" in report) == (lower_m > 3.0)
    assert (f"{abs(lower_m):.0f} m above the ground" in report) == (lower_m < -3.0)


def test_where_the_drone_took_off_is_what_its_telemetry_says(prepared: PreparedMission) -> None:
    """The simulator's drones take off from the ground under the first sample."""
    for stream in prepared.streams:
        east, north = stream.trajectory.positions_enu[0, :2]
        assert stream.trajectory.takeoff_m == pytest.approx(prepared.terrain.height(east, north), abs=0.6)


def test_every_change_of_state_of_a_run_leaves_a_line_in_its_directory(
    small_mission: Path, tmp_path: Path
) -> None:
    with logged_run(tmp_path / "run"):
        prepared = prepare(small_mission)
        finished = run_local(prepared, plan(prepared), lambda *_: None)
        write_run_directory(prepared, finished, tmp_path / "run")
    lines = [json.loads(line) for line in (tmp_path / "run/run.log").read_text().splitlines()]
    said = [(line["room"], line["event"]) for line in lines]
    for room, event, times in (
        ("ingest", "stream read", 2),
        ("ingest", "terrain read", 1),
        ("allocation", "planned", 1),
        ("mission", "run begins", 1),
        ("mission", "stream ends", 2),
        ("mission", "run ends", 1),
        ("fusion", "map finished", 1),
        ("second_look", "planned", 1),
        ("outputs", "verdict", 1),
    ):
        assert said.count((room, event)) == times, (room, event)
    substreams = len(finished.plan.assignments)
    assert said.count(("mission", "detector opened")) == substreams
    assert said.count(("fusion", "substream ends")) == substreams
    assert said.index(("allocation", "planned")) < said.index(("mission", "run begins"))
    listed = (tmp_path / "run/.run-files").read_text().splitlines()
    run = tmp_path / "run"
    assert sorted(listed) == sorted(p.relative_to(run).as_posix() for p in run.rglob("*") if p.is_file())
    assert not list(tmp_path.glob("*.log*"))


def test_streams_that_do_not_agree_are_a_finding_of_the_run(
    prepared: PreparedMission, finished: FinishedRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[object, ...]] = []

    def check(*given: object) -> list[Finding]:
        seen.append(given)
        return [Finding("warning", "streams_apart", "streams a and b", "3.0 m east")]

    monkeypatch.setattr(run_directory, "check_agreement", check)
    summary = write_run_directory(prepared, finished, tmp_path / "run")
    assert "streams_apart" in {finding.cause for finding in summary.findings}
    assert seen == [(summary.locations, prepared.mission.fusion.uncertainty)]
    assert "3.0 m east" in (tmp_path / "run/report.html").read_text()

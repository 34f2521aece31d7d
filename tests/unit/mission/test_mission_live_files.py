"""What a run shows while it flies is what its reducer holds, and at the end what its summary says."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from pipeline.fusion.possible import found_and_possible
from pipeline.mission import live_files
from pipeline.mission.durable_reducer import JournalParams
from pipeline.mission.live_files import LiveMap, begin_live, end_live
from pipeline.mission.local import FinishedRun, run_local
from pipeline.mission.planning import plan
from pipeline.mission.prepared import PreparedMission, prepare
from pipeline.mission.run_directory import write_run_directory
from pipeline.mission.run_journal import begin_journal, new_record
from pipeline.mission.stages.reducer import ReducerStage
from pipeline.outputs.live_names import FOUND, LIVE, POSSIBLE, REDUCER
from pipeline.view.files import GROUND, MAP, POSES, SIGHTINGS, find_run
from pipeline.view.ground import Ground
from pipeline.view.layer import STEPS, Layer, layer_of, layer_of_tif
from pipeline.view.poses import decoded


@pytest.fixture(scope="module")
def prepared(small_mission: Path) -> PreparedMission:
    return prepare(small_mission)


@pytest.fixture(scope="module")
def flown(
    prepared: PreparedMission, tmp_path_factory: pytest.TempPathFactory
) -> tuple[FinishedRun, Path, list[dict]]:
    """The run, its directory, and what was shown on the way."""
    out = tmp_path_factory.mktemp("live") / "run"
    planned = plan(prepared)
    journal = begin_journal(out, new_record(prepared, planned, "local"), JournalParams())
    begin_live(out, prepared)
    shown: list[dict] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(live_files, "PERIOD_S", 0.2)
        write = LiveMap.write

        def watched(self: LiveMap, stage: ReducerStage, lock: object = None) -> bool:
            done = write(self, stage, lock)  # type: ignore[arg-type]
            if done:
                found, possible = found_and_possible(
                    stage.fuser.maps, stage.fuser.looks, prepared.mission.fusion
                )
                said = json.loads((out / LIVE / REDUCER).read_text())
                places = json.loads((out / LIVE / FOUND).read_text())["features"]
                shown.append(
                    {
                        "said": said,
                        "held": (len(found), len(possible)),
                        "places": sorted(f["properties"]["probability"] for f in places),
                        "probabilities": sorted(round(p.probability, 6) for p in found),
                        "frames": {s: len(stage.frames(s)) for s in said["frames"]},
                    }
                )
            return done

        patch.setattr(LiveMap, "write", watched)
        patch.setattr(live_files, "SHARE", 0.5)
        run = run_local(prepared, planned, lambda *_: None, journal)
    return run, out, shown


def test_every_snapshot_says_what_the_reducer_held(flown: tuple[FinishedRun, Path, list[dict]]) -> None:
    _, _, shown = flown
    assert len(shown) >= 2
    for one in shown:
        assert (one["said"]["places"], one["said"]["possible"]) == one["held"]
        assert one["places"] == one["probabilities"]
        assert one["said"]["frames"] == one["frames"]
    totals = [sum(one["frames"].values()) for one in shown]
    assert totals == sorted(totals)
    assert totals[0] < totals[-1]


def test_the_last_snapshot_is_the_summary_and_the_map(
    flown: tuple[FinishedRun, Path, list[dict]], prepared: PreparedMission
) -> None:
    run, out, _ = flown
    live = LiveMap(out / LIVE, prepared)
    assert live.write(run.reducer, threading.Condition())
    folder = find_run(out)
    assert folder.state == "flying"
    kept = {name: folder.read(name) for name in (FOUND, POSSIBLE, MAP, REDUCER, SIGHTINGS, GROUND, POSES)}
    assert all(kept.values())
    summary = write_run_directory(prepared, run, out)
    content = json.loads((out / "summary.json").read_text())
    reducer = json.loads(kept[REDUCER] or "")
    assert reducer["frames"] == {s["stream"]: s["processed"] for s in content["streams"]}
    assert reducer["not_taken"] == content["evidence_not_taken"]
    assert reducer["places"] == len(summary.locations)
    assert live.figures is not None
    assert (live.figures.places, live.figures.possible) == (reducer["places"], reducer["possible"])
    looked_at = np.count_nonzero(run.reducer.fuser.map.observations) * prepared.terrain.cell_m**2
    assert live.figures.searched_m2 == pytest.approx(looked_at)
    assert looked_at > 100.0
    for name, key in ((FOUND, "found"), (POSSIBLE, "possible")):
        shown = sorted(f["properties"]["probability"] for f in json.loads(kept[name] or "")["features"])
        assert shown == sorted(place["probability"] for place in content[key])
    mine, written = Layer.decoded(kept[MAP] or b""), layer_of_tif(out / "saliency.tif")
    assert (mine.probability > 0).sum() == (written.probability > 0).sum() > 0
    assert sorted(mine.probability[mine.probability > 0]) == sorted(
        written.probability[written.probability > 0]
    )
    end_live(out)
    (out / "journal" / "run.json").unlink()
    assert find_run(out).state == "finished"
    assert {n: find_run(out).read(n) for n in (SIGHTINGS, GROUND, POSES)} == {
        n: kept[n] for n in (SIGHTINGS, GROUND, POSES)
    }


def test_nothing_is_written_while_nothing_changes_and_not_more_often_than_it_may(
    flown: tuple[FinishedRun, Path, list[dict]], prepared: PreparedMission, tmp_path: Path
) -> None:
    run, _, _ = flown
    live = LiveMap(tmp_path, prepared)
    assert live.write_if_due(run.reducer, 10.0)
    assert live.due_s == pytest.approx(10.0 + max(live_files.PERIOD_S, live.cost_s * 9.0))
    before = (tmp_path / REDUCER).stat().st_mtime_ns
    assert not live.write_if_due(run.reducer, live.due_s - 0.01)
    assert not live.write_if_due(run.reducer, live.due_s + 0.01)
    assert (tmp_path / REDUCER).stat().st_mtime_ns == before
    assert not LiveMap(tmp_path / "absent", prepared).write_if_due(run.reducer, 10.0)


def test_the_lock_is_held_for_a_tile_at_a_time(
    flown: tuple[FinishedRun, Path, list[dict]], prepared: PreparedMission, tmp_path: Path
) -> None:
    run, _, _ = flown
    held: list[float] = []

    class Lock:
        def __enter__(self) -> None:
            self.since = time.perf_counter()

        def __exit__(self, *_: object) -> None:
            held.append(time.perf_counter() - self.since)

    LiveMap(tmp_path, prepared).write(run.reducer, Lock())
    tiles = sum(int(m.tiles.touched.sum()) for m in run.reducer.fuser.maps.values())
    assert len(held) == 1 + tiles
    assert sorted(held)[len(held) // 2] < 0.05


def test_ground_and_poses_are_those_of_the_mission(
    flown: tuple[FinishedRun, Path, list[dict]], prepared: PreparedMission
) -> None:
    _, out, _ = flown
    folder = find_run(out)  # whether it is published yet or not
    ground = Ground.decoded(folder.read(GROUND) or b"")
    middle = np.array([0.0]), np.array([0.0])
    # the terrain's own height is between its cells
    assert ground.heights_at(*middle)[0] == pytest.approx(prepared.terrain.height(0.0, 0.0), abs=0.5)
    assert np.isnan(ground.heights_at(np.array([1e6]), np.array([0.0]))[0])
    flights = decoded(folder.read(POSES) or b"")
    assert [f.stream for f in flights] == [s.stream for s in prepared.streams]
    for flight, stream in zip(flights, prepared.streams, strict=True):
        number = len(flight.times_s) // 2
        pose = stream.trajectory.pose(float(flight.times_s[number]))
        assert pose is not None
        assert np.allclose(flight.pose(number).position_enu, pose.position_enu, atol=1e-3)
        assert np.allclose(flight.pose(number).enu_from_camera, pose.enu_from_camera, atol=1e-6)
        assert flight.videos == ((str(stream.path.absolute()), 0.0),)
        assert flight.video_at(1.5) == (0, 1.5)


def test_a_layer_of_put_together_cells_hides_nobody(flown: tuple[FinishedRun, Path, list[dict]]) -> None:
    run, _, _ = flown
    whole = layer_of(run.reducer.fuser.map)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.view.layer.MOST_SIDE", max(whole.probability.shape) // 3)
        coarse = layer_of(run.reducer.fuser.map)
    assert coarse.cell_m == whole.cell_m * 4
    assert coarse.probability.max() == whole.probability.max() > 1 + STEPS // 2
    assert (coarse.probability > 0).mean() >= (whole.probability > 0).mean()

"""A second flight goes on with the first one's map, sightings and accounts; what does not fit is refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import rasterio
import yaml
from rasterio.windows import Window
from typer.testing import CliRunner

from actors.cli import app
from pipeline.errors import InputError, SearchlightError
from pipeline.mission.local import FinishedRun, run_local
from pipeline.mission.onto import STATE_FILE, EarlierRun, read_earlier_run
from pipeline.mission.planning import plan
from pipeline.mission.prepared import PreparedMission, prepare
from pipeline.mission.run_directory import write_run_directory


def one_drone(small_mission: Path, folder: Path, number: int, **fusion: object) -> Path:
    """A mission with one of the two drones; what it takes from the folder of both it names by its path."""
    document = yaml.safe_load(small_mission.read_text())
    stream = document["streams"][number]
    for key in ("video", "camera"):
        stream[key] = str(small_mission.parent / stream[key])
    stream["telemetry"]["file"] = str(small_mission.parent / stream["telemetry"]["file"])
    document["streams"] = [stream]
    document["terrain"]["file"] = str(small_mission.parent / document["terrain"]["file"])
    document["truth"] = str(small_mission.parent / document["truth"])
    for name in ("inventory", "pool"):
        document[name] = str(small_mission.parent / document[name])
    inventory = yaml.safe_load((small_mission.parent / "inventory.yaml").read_text())
    inventory["links"] = [link for link in inventory["links"] if link["stream"] == stream["id"]]
    folder.mkdir()
    (folder / "inventory.yaml").write_text(yaml.safe_dump(inventory))
    document["inventory"] = "inventory.yaml"
    document["fusion"] |= fusion
    document["name"] = f"flight of {stream['id']}"
    (folder / "mission.yaml").write_text(yaml.safe_dump(document))
    return folder / "mission.yaml"


def flown(mission: Path, out: Path, onto: EarlierRun | None = None) -> tuple[PreparedMission, FinishedRun]:
    prepared = prepare(mission, onto)
    finished = run_local(prepared, plan(prepared), lambda *_: None)
    write_run_directory(prepared, finished, out)
    return prepared, finished


@pytest.fixture(scope="module")
def missions(small_mission: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("onto")
    return [one_drone(small_mission, folder / str(k), k) for k in range(2)]


@pytest.fixture(scope="module")
def first(missions: list[Path]) -> tuple[Path, FinishedRun]:
    out = missions[0].parent / "run"
    return out, flown(missions[0], out)[1]


@pytest.fixture(scope="module")
def both(missions: list[Path], first: tuple[Path, FinishedRun]) -> tuple[Path, PreparedMission, FinishedRun]:
    out = missions[1].parent / "both"
    prepared, finished = flown(missions[1], out, read_earlier_run(first[0]))
    return out, prepared, finished


def layers(run: FinishedRun, name: str) -> dict[tuple[float, float], float]:
    """A layer where it is not 0, by the middle of the cell."""
    voxel_map = run.reducer.fuser.map
    values = voxel_map.layer(name)
    rows, columns = np.nonzero(values)
    centers = voxel_map.terrain.centers(rows, columns)[:, :2].round(6)
    return dict(zip(map(tuple, centers.tolist()), values[rows, columns].tolist(), strict=True))


def test_the_second_flight_adds_to_the_first(
    missions: list[Path],
    first: tuple[Path, FinishedRun],
    both: tuple[Path, PreparedMission, FinishedRun],
    tmp_path: Path,
) -> None:
    _, alone = flown(missions[1], tmp_path / "alone")
    for name in ("observations", "looks"):
        of_both, of_each = layers(both[2], name), [layers(run, name) for run in (first[1], alone)]
        cells = of_each[0].keys() | of_each[1].keys()
        assert of_both.keys() == cells
        wrong = [c for c in cells if of_both[c] != sum(one.get(c, 0) for one in of_each)]
        assert not wrong, (name, len(wrong))
    pods = [layers(run, "pod") for run in (first[1], alone)]
    for cell, pod in layers(both[2], "pod").items():
        each = [one.get(cell, 0.0) for one in pods]
        assert pod == pytest.approx(1.0 - (1.0 - each[0]) * (1.0 - each[1]), abs=1e-5)


def test_its_sightings_are_those_of_both_and_its_streams_have_names_of_their_own(
    first: tuple[Path, FinishedRun], both: tuple[Path, PreparedMission, FinishedRun]
) -> None:
    looks = both[2].reducer.fuser.looks
    earlier = [k for k in looks if k.stream == "drone-1#1"]
    assert len(earlier) == len(first[1].reducer.fuser.looks) > 0
    assert {k.stream for k in looks} == {"drone-1#1", "drone-2"}
    terrain = both[1].terrain
    for look in looks:
        assert (look.row, look.column) == terrain.cell(*look.intersection_enu[:2])
    assert both[1].terrain.shape != first[1].reducer.fuser.map.terrain.shape  # the map has grown


def test_its_accounts_go_on(
    first: tuple[Path, FinishedRun], both: tuple[Path, PreparedMission, FinishedRun]
) -> None:
    before = json.loads((first[0] / "summary.json").read_text())
    after = json.loads((both[0] / "summary.json").read_text())
    assert [s["stream"] for s in after["streams"]] == ["drone-2"]
    (flight,) = after["earlier_flights"]
    assert (flight["number"], flight["mission"]) == (1, "flight of drone-1")
    (account,) = flight["streams"]
    assert account | {"stream": "drone-1"} == before["streams"][0]
    assert account["captured"] == account["processed"] + sum(account["dropped"].values())
    assert len(after["found"]) >= len(before["found"])
    streams = {stream for place in after["found"] for stream in place["streams"]}
    assert streams == {"drone-1#1", "drone-2"}
    report = (both[0] / "report.html").read_text()
    assert "flight of drone-1" in report
    assert "drone-1#1" in report
    places = {place["id"] for place in (*after["found"], *after["possible"])}
    pictures = report.count('<img alt="Picture of ')
    assert pictures == len(places)  # of those that the first flight alone has seen too


def test_a_third_flight_goes_on_with_both(both: tuple[Path, PreparedMission, FinishedRun]) -> None:
    earlier = read_earlier_run(both[0])
    assert [f.number for f in earlier.flights] == [1, 2]
    assert {k.stream for k in earlier.looks} == {"drone-1#1", "drone-2#2"}
    assert set(earlier.tracks) == {"drone-1#1", "drone-2#2"}


def kept(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def refused(mission: Path, run: Path, *said: str) -> None:
    before = kept(run)
    with pytest.raises(SearchlightError) as caught:
        prepare(mission, read_earlier_run(run))
    for text in said:
        assert text in str(caught.value), str(caught.value)
    assert kept(run) == before


def test_a_map_of_another_cell_size_is_refused(
    small_mission: Path, first: tuple[Path, FinishedRun], tmp_path: Path
) -> None:
    for k, cell_m in enumerate((1.0, 0.25, 0.5000001)):
        mission = one_drone(small_mission, tmp_path / str(k), 1, cell_size={"meters": cell_m})
        refused(mission, first[0], "a map in cells of 0.5 m", f"cells of {cell_m:g} m")


def test_a_map_of_another_frame_is_refused(
    small_mission: Path, first: tuple[Path, FinishedRun], tmp_path: Path
) -> None:
    mission = one_drone(small_mission, tmp_path / "m", 1)
    with rasterio.open(small_mission.parent / "terrain.tif") as source:
        window = Window(0, 0, source.width - 4, source.height)  # type: ignore[call-arg]
        profile = source.profile | {"width": source.width - 4, "transform": source.window_transform(window)}
        heights = source.read(1, window=window)
    with rasterio.open(tmp_path / "m/other.tif", "w", **profile) as target:
        target.write(heights, 1)
    document = yaml.safe_load(mission.read_text())
    document["terrain"]["file"] = "other.tif"
    mission.write_text(yaml.safe_dump(document))
    refused(mission, first[0], "a map about", "the same terrain.file")


def test_a_map_with_other_layers_or_limits_is_refused(
    small_mission: Path, first: tuple[Path, FinishedRun], tmp_path: Path
) -> None:
    car = {
        "id": 2,
        "name": "car",
        "significant_point": "center",
        "object_size": {
            f"{s}_{e}": {"meters": m} for s in ("width", "height") for e, m in (("min", 1), ("max", 6))
        },
    }
    mission = one_drone(small_mission, tmp_path / "a", 1, further_classes=[car])
    refused(mission, first[0], "layers person", "person, car")
    refused(one_drone(small_mission, tmp_path / "b", 1, clamp_min=0.2), first[0], "clamp_min and clamp_max")


def test_the_same_flight_counts_once(missions: list[Path], first: tuple[Path, FinishedRun]) -> None:
    refused(missions[0], first[0], "the flight of drone-1 already", "would count twice")


def test_what_is_no_run_or_is_damaged_is_refused(first: tuple[Path, FinishedRun], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=STATE_FILE):
        read_earlier_run(tmp_path)
    shutil.copytree(first[0], tmp_path / "run")
    state = tmp_path / "run" / STATE_FILE
    data = bytearray(state.read_bytes())
    data[len(data) // 2] ^= 1
    state.write_bytes(data)
    with pytest.raises(InputError, match="checksum"):
        read_earlier_run(tmp_path / "run")
    state.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError):
        read_earlier_run(tmp_path / "run")


def test_the_command_hands_the_run_on_and_refuses_in_one_line(
    small_mission: Path, first: tuple[Path, FinishedRun], tmp_path: Path
) -> None:
    mission = one_drone(small_mission, tmp_path / "m", 1, cell_size={"meters": 1.0})
    before = kept(first[0])
    arguments = ["run", mission, "--local", "--out", tmp_path / "out", "--onto", first[0]]
    outcome = CliRunner().invoke(app, [str(a) for a in arguments])
    assert isinstance(outcome.exception, InputError)
    assert outcome.exception.exit_code == 2
    assert "in cells of 0.5 m" in str(outcome.exception)
    assert kept(first[0]) == before
    assert not (tmp_path / "out").exists()


def test_own_detections_go_on_with_a_map_that_other_own_detections_made(
    missions: list[Path], tmp_path: Path
) -> None:
    def fused(number: int, name: str, *more: object) -> EarlierRun:
        rows = [f"drone-{number + 1},{k},300,200,330,260,0.9,person" for k in (3, 6, 9)]
        listed = tmp_path / f"{name}.csv"
        listed.write_text("\n".join(["stream,frame,x0,y0,x1,y1,score,class", *rows]))
        arguments = ["fuse", missions[number], "--detections", listed, "--out", tmp_path / name]
        outcome = CliRunner().invoke(app, [str(a) for a in (*arguments, "--first-frame", 0, *more)])
        if outcome.exception is not None:
            raise outcome.exception
        return read_earlier_run(tmp_path / name)

    def observations(name: str) -> float:
        with rasterio.open(tmp_path / name / "saliency.tif") as source:
            return float(np.nansum(source.read(source.descriptions.index("observations") + 1)))

    one, alone = fused(0, "one"), fused(1, "alone")
    both = fused(1, "both", "--onto", tmp_path / "one")
    assert len(one.looks) == len(alone.looks) == 3
    times_ns = sorted(look.time_ns for look in (*one.looks, *alone.looks))
    assert sorted(look.time_ns for look in both.looks) == times_ns
    assert observations("both") == observations("one") + observations("alone") > 0.0
    assert len(both.flights) == 2
    with pytest.raises(InputError, match="already"):
        fused(1, "again", "--onto", tmp_path / "both")
    assert not (tmp_path / "again").exists()

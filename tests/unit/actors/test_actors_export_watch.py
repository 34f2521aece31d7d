"""A writer that stands for a mission that flies: what it writes is handed over within two seconds."""

from __future__ import annotations

import asyncio
import json
import shutil
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from test_actors_cot_sender import Server, free_port
from typer.testing import CliRunner

from actors.cli import app
from actors.cot_sender import CotSender
from actors.drone_events import DroneEvents
from actors.export_watch import Follower, Wanted, with_sender
from pipeline.errors import InputError, RunFailedError
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.mission import live_files as files
from pipeline.outputs.exports import live
from pipeline.outputs.exports.redaction import redacted
from pipeline.outputs.exports.view import read_run
from pipeline.outputs.live_names import REDUCER
from pipeline.view.files import GROUND, POSES
from pipeline.view.ground import Ground
from pipeline.view.poses import Flight, encoded

sys.path.append(str(Path(__file__).parents[1] / "outputs"))
from run_folder import write_run


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("watch") / "finished", "ridge")


def fly(run: Path, finished: Path, ids: list[int], probability: float | None = None) -> None:
    """Write ``live/`` as a mission does: the possible places, then the found ones, each in one step."""
    live = run / "live"
    live.mkdir(parents=True, exist_ok=True)
    (live / "status.json").write_text(json.dumps({"mission": "ridge"}))
    for name in ("possible.geojson", "salient.geojson"):
        document = json.loads((finished / name).read_text())
        document["features"] = [f for f in document["features"] if f["id"] in ids]
        for feature in document["features"]:
            feature["properties"]["pictures"] = []
            if probability is not None:
                feature["properties"]["probability"] = probability
        (live / f".{name}").write_text(json.dumps(document))
        (live / f".{name}").replace(live / name)


async def until(condition: object, within_s: float = 2.0) -> float:
    assert callable(condition)
    begun = time.monotonic()
    while not condition():
        assert time.monotonic() - begun < within_s, "not within time"
        await asyncio.sleep(0.01)
    return time.monotonic() - begun


def test_what_a_mission_finds_is_handed_over_within_two_seconds(finished: Path, tmp_path: Path) -> None:
    run, out, port = tmp_path / "run", tmp_path / "out", free_port()

    async def scenario() -> None:
        sender = CotSender(f"tcp://127.0.0.1:{port}", lambda _: None)
        follower = Follower(Wanted(run, out, ("geojson", "cot", "cog"), lambda v: v), sender, lambda _: None)
        work = asyncio.ensure_future(follower.follow())
        all_sent = asyncio.ensure_future(with_sender(sender, work, 10.0))

        def names() -> set[str]:
            try:
                features = json.loads((out / "places.geojson").read_text())["features"]
            except FileNotFoundError:
                return set()
            return {f["properties"]["name"].split(" (")[0] for f in features if "rank" in f["properties"]}

        async with Server(port) as server:

            def kinds() -> list[tuple[str, str]]:
                found = [etree.fromstring(data.strip()) for data in server.read]
                return [(str(e.get("uid"))[-2:], str(e.get("type"))) for e in found]

            fly(run, finished, [1])
            await until(lambda: names() == {"Place 1"} and len(server.read) == 1)
            fly(run, finished, [1, 2, 4])
            await until(
                lambda: names() == {"Place 1", "Place 2", "Possible place 4"} and len(server.read) == 3
            )
            # nothing new: nothing is sent
            fly(run, finished, [1, 2, 4])
            await asyncio.sleep(0.6)
            assert len(server.read) == 3
            # one is gone: its marker is taken away; the other's probability has changed
            fly(run, finished, [1], probability=0.99)
            await until(lambda: len(server.read) == 6)
            assert sorted(kinds()[3:]) == [("-1", "b-m-p-s-m"), ("-2", "t-x-d-d"), ("-4", "t-x-d-d")]
            # a file that is no GeoJSON is told, and does not end it
            (run / "live/salient.geojson").write_text("{")
            await asyncio.sleep(0.4)
            assert not work.done()
            # the run ends: live/ goes, what was published is handed over
            shutil.copytree(finished, run, dirs_exist_ok=True)
            shutil.rmtree(run / "live")
            assert await asyncio.wait_for(all_sent, 10.0)
            await until(lambda: len(server.read) == 6 + 5)
        assert len(names()) == 5
        assert (out / "saliency.cog.tif").is_file()

    asyncio.run(scenario())


def test_a_finished_run_is_sent_by_the_command(finished: Path, tmp_path: Path) -> None:
    async def scenario() -> None:
        async with Server(free_port()) as server:
            url = f"tcp://127.0.0.1:{server.port}"
            arguments = ["export", str(finished), "--to", "cot", "--out", str(tmp_path), "--send", url]
            result = await asyncio.to_thread(CliRunner().invoke, app, arguments)
            assert result.exception is None
            await until(lambda: len(server.read) == 5)
            assert len(set(server.uids)) == 5

    asyncio.run(scenario())


def test_nobody_there_is_exit_code_1_after_the_time_given(finished: Path, tmp_path: Path) -> None:
    url = f"tcp://127.0.0.1:{free_port()}"
    arguments = ["export", str(finished), "--to", "cot", "--out", str(tmp_path), "--send", url]
    result = CliRunner().invoke(app, [*arguments, "--give-up-after", "0.4"])
    assert isinstance(result.exception, RunFailedError)
    assert "5 events could not be sent within 0.4 s" in str(result.exception)
    assert (tmp_path / "cot/place-1.cot").is_file()


@pytest.mark.parametrize(
    "arguments", [["--to", "kml", "--send", "tcp://127.0.0.1:1"], ["--to", "cot", "--send", "x"]]
)
def test_what_cannot_be_sent_is_refused(finished: Path, tmp_path: Path, arguments: list[str]) -> None:
    result = CliRunner().invoke(app, ["export", str(finished), "--out", str(tmp_path), *arguments])
    assert isinstance(result.exception, InputError)
    assert list(tmp_path.iterdir()) == []


def test_a_drone_is_where_it_took_its_newest_picture(finished: Path, tmp_path: Path) -> None:
    camera = Camera(640, 360, 500.0, 500.0, 320.0, 180.0)
    times = np.arange(0.0, 10.0, 0.2)
    way = np.stack([5.0 * times, 100.0 - 2.0 * times, np.full_like(times, 50.0)], axis=1)
    flight = Flight("drone-1", "air", camera, 10**18, (), times, way, np.zeros((50, 3, 3)), np.ones(50))
    frame = LocalFrame(63.4, 10.4)
    folder = tmp_path / "live"
    folder.mkdir()
    view = read_run(finished, datetime(2026, 5, 1, tzinfo=UTC))
    drones = DroneEvents(tmp_path)
    assert drones.now(view) == {}
    (folder / GROUND).write_bytes(Ground(frame, 0.0, 0.0, 1.0, np.zeros((2, 2), dtype=np.float32)).encoded())
    (folder / POSES).write_bytes(encoded([flight]))
    for time_s in (0.0, 3.1, 99.0):
        newest = {"drone-1": 10**18 + int(time_s * 1e9), "other": 5}
        (folder / REDUCER).write_text(json.dumps({"newest_ns": newest}))
        ((uid, event),) = drones.now(view).items()
        point = etree.fromstring(event).find("point")
        at_s = min(time_s, times[-1])
        latitude, longitude = frame.wgs84_from_enu(np.array(5.0 * at_s), np.array(100.0 - 2.0 * at_s))
        # positions are kept as float32: a hundredth of a millimetre here
        assert float(point.get("lat")) == pytest.approx(float(latitude), abs=1e-7)
        assert float(point.get("lon")) == pytest.approx(float(longitude), abs=1e-7)
        assert point.get("hae") == "9999999.0"
        assert uid.endswith("-drone-drone-1")
    assert drones.now(redacted(view)) == {}
    (folder / REDUCER).write_text("{")
    assert drones.now(view) == {}


def test_the_names_of_the_live_files_are_those_that_are_written() -> None:
    assert (live.LIVE, live.FOUND, live.POSSIBLE) == (files.LIVE, files.FOUND, files.POSSIBLE)
    assert (live.STATUS, live.REDUCER) == (files.STATUS, files.REDUCER)

"""A mission of live streams: looked at when it is prepared, counted while it flies, a recording once it is over."""

from __future__ import annotations

import pickle
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from actors.commands.run import RunRequest, run_mission
from pipeline.allocation.plan import Assignment
from pipeline.errors import InputError
from pipeline.ingest.live.source import LiveSource
from pipeline.ingest.telemetry.mavlink_frames import frames_in
from pipeline.messages import Packet
from pipeline.mission.flown import Flown, as_flown
from pipeline.mission.fuse import fuse
from pipeline.mission.live_files import LiveWays, write_flight
from pipeline.mission.noticed import noticed
from pipeline.mission.one_picture import push_one_picture
from pipeline.mission.own_detections import OwnDetector
from pipeline.mission.planning import plan
from pipeline.mission.prepared import PreparedMission, prepare
from pipeline.mission.stages.source import SourceStage
from pipeline.mission.stages.virtual_link import VirtualLink
from pipeline.view.files import POSES
from pipeline.view.poses import decoded
from tests.dialects import mavlink_tlog
from tests.dialects.demo import DEMO, STREAMS, at_rate, mission_with, true_track
from tests.live_sender import Order, start
from tests.unit.ingest.live_streams import free_port


def live_mission(folder: Path, url: str) -> Path:
    """The demo's mission with its first drone alone, live."""
    path = mission_with(folder, {"drone-1": {"file": url, "height_datum": "ellipsoid"}, "drone-2": None})
    mission = yaml.safe_load(path.read_text(encoding="utf-8"))
    del mission["streams"][1]
    mission["streams"][0] |= {"video": url, "live": {"wait": {"seconds": 15}}}
    inventory = yaml.safe_load(Path(mission["inventory"]).read_text(encoding="utf-8"))
    inventory["links"] = inventory["links"][:1]
    (folder / "inventory.yaml").write_text(yaml.safe_dump(inventory), encoding="utf-8")
    path.write_text(yaml.safe_dump(mission | {"inventory": "inventory.yaml"}), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def sender() -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    url = f"udp://127.0.0.1:{free_port()}"
    order = Order(f"{url}?pkt_size=1316", seconds=None, size=(256, 144), track=str(DEMO / "drone-1.srt"))
    process = start(order)
    yield url, process
    process.kill()


@pytest.fixture(scope="module")
def prepared(
    sender: tuple[str, subprocess.Popen[bytes]], tmp_path_factory: pytest.TempPathFactory
) -> PreparedMission:
    folder = tmp_path_factory.mktemp("live")
    (folder / "camera.yaml").write_text(
        "width: 256\nheight: 144\nfx: 225.0\nfy: 225.0\ncx: 128.0\ncy: 72.0\n", encoding="utf-8"
    )
    path = live_mission(folder, sender[0])
    text = path.read_text(encoding="utf-8").replace(str(DEMO / "camera.yaml"), "camera.yaml")
    path.write_text(text, encoding="utf-8")
    return prepare(path)


def test_what_was_found_is_one_line_and_its_place_is_on_the_map(prepared: PreparedMission) -> None:
    (line,) = [f.found for f in prepared.findings if f.cause == "live"]
    assert line.startswith("live: h264 256 x 144 at 10.")
    assert line.endswith("positions a second from KLV; capture times by the stamps of its KLV")
    (stream,) = prepared.streams
    east, north, _ = stream.known_way.positions_enu[-1]
    west, south = prepared.terrain.east_m, prepared.terrain.north_m
    rows, columns = prepared.terrain.shape
    assert west < east < west + columns * prepared.terrain.cell_m
    assert south < north < south + rows * prepared.terrain.cell_m
    assert set(prepared.findings) <= set(noticed(prepared).findings)


def test_a_picture_goes_all_its_way_before_the_mission_begins(prepared: PreparedMission) -> None:
    assert push_one_picture(prepared, plan(prepared)) == []


def test_a_live_stream_is_counted_like_any_other(prepared: PreparedMission) -> None:
    (stream,) = prepared.streams
    stream = pickle.loads(pickle.dumps(stream))  # as it goes to its drone
    assert isinstance(stream.source, LiveSource)
    sent: list[object] = []
    link = VirtualLink({"ground": float("inf")}, lambda detector, message: sent.append(message))
    given = Assignment(stream.stream, "d", "d", "m", "ground", 1, 0, 1e6)
    stage, beats = SourceStage(stream, (given,), link), 0

    class EnoughError(Exception):
        pass

    def wait_until(video_s: float | None) -> float:
        nonlocal beats
        beats += 1
        if len(sent) >= 20 or beats > 400:
            raise EnoughError
        return video_s or 0.0

    with pytest.raises(EnoughError):
        stage.run(wait_until)
    count = stage.count
    packets = [message for message in sent if isinstance(message, Packet)]
    assert len(packets) >= 20
    assert count.captured == len(count.due) + len(count.lost) + count.not_sampled
    assert len(count.due) - len(count.dropped) == len(packets)
    assert stream.source.health.basis == "klv"
    # on the way that its subtitles tell, to what a packet of KLV can hold, and as fast as it was flown
    track = true_track("drone-1")
    true = np.stack(prepared.frame.enu_from_wgs84(track.latitude_deg, track.longitude_deg), axis=1)
    reached = []
    for packet in packets:
        away_m = np.linalg.norm(true - packet.pose.position_enu[:2], axis=1)
        assert float(away_m.min()) < 0.1
        reached.append(float(track.times_s[away_m.argmin()]))
    filmed_s = (packets[-1].time_ns - packets[0].time_ns) * 1e-9
    assert reached[-1] - reached[0] == pytest.approx(filmed_s, abs=0.1)


def test_once_it_is_over_it_is_as_a_recording(prepared: PreparedMission, tmp_path: Path) -> None:
    (stream,) = prepared.streams
    way = stream.known_way
    one = np.array([0.0, *way.positions_enu[0], *way.angles_rad[0], *way.sds[0], way.focal_scale[0]])
    rows, later = (
        one + np.outer(np.arange(a, b) / 10.0, [1.0] * 2 + [0.0] * 9) for a, b in ((0, 10), (10, 30))
    )
    flown = as_flown(prepared, Flown({stream.stream: np.concatenate([rows, later])}, {stream.stream: 3.0}))
    (over,) = flown.streams
    assert not over.is_live
    assert over.end_s == pytest.approx(3.1, abs=0.02)
    assert len(over.known_way.times_s) == 30
    write_flight(tmp_path, flown)
    (whole,) = decoded((tmp_path / POSES).read_bytes())
    ways, told = LiveWays(tmp_path, prepared), Flown({stream.stream: rows}, {stream.stream: 1.0})
    ways.write_if_due(lambda: told, 0.0)
    (so_far,) = decoded((tmp_path / POSES).read_bytes())
    assert (len(so_far.times_s), len(whole.times_s)) == (5, 15)
    told = Flown({stream.stream: np.concatenate([rows, later])}, {stream.stream: 3.0})
    ways.write_if_due(lambda: told, 1.0)
    assert len(decoded((tmp_path / POSES).read_bytes())[0].times_s) == len(so_far.times_s), "not due"
    ways.write_if_due(lambda: told, 2.5)
    assert len(decoded((tmp_path / POSES).read_bytes())[0].times_s) == len(whole.times_s)
    nothing = as_flown(prepared, Flown())
    assert nothing.streams[0].known_way.times_s == pytest.approx(way.times_s)


@pytest.mark.slow
def test_pictures_get_the_poses_that_mavlink_tells_beside_them(tmp_path: Path) -> None:
    ports = [free_port(), free_port()]
    url = f"udp://127.0.0.1:{ports[0]}"
    track, stop = at_rate(true_track("drone-1"), 10.0), threading.Event()
    begun_ns = time.time_ns()
    frames = stamped_frames(bytes(mavlink_tlog.log_of(replace(track, start_time_ns=begun_ns)).data))

    def fly() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for at_us, frame in frames:
                if stop.wait(max(0.0, at_us * 1e-6 - time.time())):
                    return
                out.sendto(frame, ("127.0.0.1", ports[1]))

    sender = start(Order(f"{url}?pkt_size=1316", seconds=None, size=(256, 144)))
    threading.Thread(target=fly, daemon=True).start()
    path = live_mission(tmp_path, url)
    mission = yaml.safe_load(path.read_text(encoding="utf-8"))
    mission["streams"][0]["telemetry"] = {"file": f"udp://127.0.0.1:{ports[1]}", "height": "absolute"}
    mission["streams"][0]["camera"] = {"field_of_view": {"degrees": 60, "of": "horizontal"}}
    path.write_text(yaml.safe_dump(mission), encoding="utf-8")
    try:
        ready = prepare(path)
        (stream,) = ready.streams
        poses = []
        for frame in SourceStage(stream, (), VirtualLink({}, lambda *_: None)).frames():
            poses.append((frame.time_ns, frame.pose))
            if len(poses) >= 40:
                break
    finally:
        stop.set()
        sender.kill()
    assert any("from udp:" in f.found for f in ready.findings if f.cause == "live")
    true = np.stack(ready.frame.enu_from_wgs84(track.latitude_deg, track.longitude_deg), axis=1)
    for time_ns, pose in poses[5:]:
        at_s = (time_ns - begun_ns) * 1e-9
        east, north = (np.interp(at_s, track.times_s - track.times_s[0], true[:, k]) for k in (0, 1))
        # video and telemetry both by arrival: off by what the one came later than the other, at 5 m/s
        assert np.hypot(pose.position_enu[0] - east, pose.position_enu[1] - north) < 2.0


def stamped_frames(data: bytes) -> list[tuple[int, bytes]]:
    """The frames of a log, each with the time at which it was received, microseconds since 1970."""
    found, position = [], 0
    while position < len(data):
        frame = next(frames_in(data[position + 8 :]))
        found.append((int.from_bytes(data[position : position + 8], "big"), frame))
        position += 8 + len(frame)
    return sorted(found)


def _request(mission: Path, out: Path, **other: object) -> RunRequest:
    request = RunRequest(mission, out, "max", False, None, None, "127.0.0.1", None, None, 60.0)
    return replace(request, **other)  # type: ignore[arg-type]


def test_in_one_process_it_does_not_run_and_of_files_of_detections_there_are_none(
    prepared: PreparedMission, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="without --local"):
        run_mission(_request(prepared.path, tmp_path / "run", local=True))
    with pytest.raises(InputError, match="live streams"):
        fuse(prepared.path, tmp_path / "no.json", None, None, OwnDetector("x"))


def test_a_drone_that_only_films_is_planned_for(tmp_path: Path) -> None:
    known = {"format": "dji-srt", "height_datum": "ellipsoid", "utc_offset": {"hours": 0}}
    path = mission_with(tmp_path, {name: known | {"file": str(DEMO / f"{name}.srt")} for name in STREAMS})
    mission = yaml.safe_load(path.read_text(encoding="utf-8"))
    inventory = yaml.safe_load(Path(mission["inventory"]).read_text(encoding="utf-8"))
    for site in inventory["sites"]:
        if site["id"] != "ground":
            del site["machines"]
    (tmp_path / "inventory.yaml").write_text(yaml.safe_dump(inventory), encoding="utf-8")
    path.write_text(yaml.safe_dump(mission | {"inventory": "inventory.yaml"}), encoding="utf-8")
    assert {a.site for a in plan(prepare(path)).assignments} == {"ground"}

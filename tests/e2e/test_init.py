"""From an SD card's folder beside an elevation model to a mission that runs unedited, or says what is missing."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import av
import numpy as np
import pytest
import rasterio
from PIL import Image
from rasterio.windows import Window

from actors.cli import main
from pipeline.config.mission import load_mission
from pipeline.errors import InputError
from pipeline.ingest.telemetry.dji_srt import read_dji_srt
from pipeline.init import init_mission as init_module
from pipeline.init.contents import contents_of
from pipeline.init.draft import mission_text
from pipeline.init.init_mission import draft_of, init_mission
from pipeline.mission.one_picture import push_one_picture
from pipeline.mission.planning import plan
from pipeline.mission.prepared import prepare
from tests.dialects import demo, dji_subtitles, video_text_track
from tests.stills import write_still

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def card(small_mission: Path, tmp_path: Path) -> Path:
    """Two videos of other lengths, their subtitles exchanged by name, the terrain in three tiles, a text file."""
    source, folder = small_mission.parent, tmp_path / "card"
    (folder / "DCIM").mkdir(parents=True)
    (folder / "dem").mkdir()
    shutil.copy(source / "drone-1.mp4", folder / "DCIM/DJI_0001.MP4")
    shorten(source / "drone-2.mp4", folder / "DCIM/DJI_0007.MP4", seconds=3.0)
    shutil.copy(source / "drone-1.srt", folder / "DCIM/DJI_0007.SRT")
    cues = (source / "drone-2.srt").read_text(encoding="utf-8").split("\n\n")
    (folder / "DCIM/DJI_0001.SRT").write_text("\n\n".join(cues[:90]) + "\n\n", encoding="utf-8")
    shutil.copy(source / "camera.yaml", folder / "camera.yaml")
    with rasterio.open(source / "terrain.tif") as terrain:
        for k in range(3):
            first, last = (terrain.width * k // 3, terrain.width * (k + 1) // 3)
            window = Window(first, 0, last - first, terrain.height)
            profile = terrain.profile | {"width": last - first, "transform": terrain.window_transform(window)}
            with rasterio.open(folder / f"dem/tile-{k}.tif", "w", **profile) as tile:
                tile.write(terrain.read(window=window))
    (folder / "notes.txt").write_text("call the sheriff\n", encoding="utf-8")
    return folder


def shorten(source: Path, target: Path, seconds: float) -> None:
    with av.open(str(source)) as read, av.open(str(target), "w", format="mp4") as written:
        video = read.streams.video[0]
        stream = written.add_stream_from_template(video)
        for packet in read.demux(video):
            if packet.pts is not None and packet.pts * packet.time_base < seconds:
                packet.stream = stream
                written.mux(packet)


@pytest.fixture
def quick_pool(monkeypatch: pytest.MonkeyPatch) -> None:
    """The shipped pool instead of one that is measured for half a minute."""

    def copied(path: Path, image: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], progress: object) -> None:
        text = (ROOT / "configs/pools/demo.yaml").read_text(encoding="utf-8")
        text = text.replace("../detectors", str(ROOT / "configs/detectors")).replace(
            "workstation", "this-machine"
        )
        path.write_text(text, encoding="utf-8")

    monkeypatch.setattr(init_module, "write_measured_pool", copied)


EXPECTED = """\
# Written by searchlight init. "assumed:" was not in the files; check it. Units are in the keys.
version: 1
name: card

terrain:
  file:
  - dem/tile-0.tif
  - dem/tile-1.tif
  - dem/tile-2.tif
# assumed: the ground that the drones' ways enclose is to be searched; or give search_area: FILE.geojson

streams:
- id: DJI_0001
  video: DCIM/DJI_0001.MP4
  telemetry:
    file: DCIM/DJI_0007.SRT
    # by length and date, not by name: DJI_0007.SRT covers 5.0 s and DJI_0001.SRT 3.0 s of a video of 5.0 s
    height: absolute  # above the ellipsoid, take-off is {first} m from the ground under the first sample
    height_datum: ellipsoid
  camera: camera.yaml
  site: here
- id: DJI_0007
  video: DCIM/DJI_0007.MP4
  telemetry:
    file: DCIM/DJI_0001.SRT
    # by length and date, not by name: DJI_0001.SRT covers 3.0 s and DJI_0007.SRT 5.0 s of a video of 3.1 s
    height: absolute  # above the ellipsoid, take-off is {second} m from the ground under the first sample
    height_datum: ellipsoid
  camera: camera.yaml
  site: here

inventory: inventory.yaml  # this machine
pool: pool.yaml  # the detectors that come with Searchlight, their times measured on this machine
# assumed: the shipped detectors, which have seen simulated people only, find those in your pictures

processing:
  frame_rate: {{hertz: 5}}
  max_processing_time: {{seconds: 2}}
  bitrates: [{{mbps: 1}}, {{mbps: 4}}, {{mbps: 8}}]
fusion:
  cell_size: {{meters: 2}}  # assumed: positions are good to a metre or so; 0.5 m with RTK
  positive_max: 0.36
  negative_max: 0.2
  tukey_alpha: 0.5
  significant_point: bottom_center
  object_size:
    {{width_min: {{meters: 0.2}}, width_max: {{meters: 2.2}}, height_min: {{meters: 0.2}}, height_max: {{meters: 2.2}}}}
  threshold: 0.7
  cluster_distance: {{meters: 3}}
  lateness: {{seconds: 2}}

# not used: notes.txt: telemetry of an unknown format
"""


def test_a_card_with_exchanged_subtitles_and_three_tiles_becomes_this_mission(
    card: Path, quick_pool: None
) -> None:
    result = init_mission(card, lambda *_: None)
    text = (card / "mission.yaml").read_text(encoding="utf-8")
    offsets = [
        line.split("take-off is ")[1].split(" m")[0] for line in text.splitlines() if "take-off is" in line
    ]
    assert all(abs(float(offset)) < 1.0 for offset in offsets)
    assert text.rstrip() == EXPECTED.format(first=offsets[0], second=offsets[1]).rstrip()
    assert result.to_fill == ()
    assert [path.name for path in result.unused] == ["notes.txt"]


def test_it_runs_unedited(
    card: Path, quick_pool: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    init_mission(card, lambda *_: None)
    monkeypatch.chdir(card.parent)
    monkeypatch.setattr(sys, "argv", ["searchlight", "run", "--local"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code in (0, None), capsys.readouterr().err
    assert (card / "run/report.html").is_file()


def test_what_only_a_person_can_know_is_listed_and_the_mission_is_refused_until_it_is_filled_in(
    card: Path, quick_pool: None
) -> None:
    (card / "camera.yaml").unlink()
    shutil.rmtree(card / "dem")
    (card / "DCIM/DJI_0001.SRT").unlink()
    result = init_mission(card, lambda *_: None)
    # the other video's subtitles say a focal length
    assert len(result.to_fill) == 3, result.to_fill
    assert "mm are" in result.mission.read_text(encoding="utf-8")
    text = " ".join(result.to_fill)
    for field in ("file: FILL IN", "field_of_view"):
        assert field in text
    with pytest.raises(InputError) as refused:
        load_mission(result.mission)
    lines = str(refused.value).splitlines()
    assert [line.split(":")[1].split()[0] for line in lines] == [f.split(":")[0][5:] for f in result.to_fill]
    assert all("FILL IN" in line and "only you can know it" in line for line in lines)


def test_nothing_is_overwritten_and_an_empty_folder_is_refused(card: Path, tmp_path: Path) -> None:
    (card / "pool.yaml").write_text("mine")
    (tmp_path / "empty").mkdir()
    for folder, found in (
        (card, "there already"),
        (tmp_path / "empty", "no video"),
        (tmp_path / "none", "no folder"),
    ):
        command = [sys.executable, "-m", "actors", "init", str(folder)]
        result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert result.returncode == 2
        assert found in result.stderr.replace("\n", " ")
    assert (card / "pool.yaml").read_text() == "mine"
    assert not (card / "mission.yaml").exists()


def test_telemetry_inside_the_videos_is_found(tmp_path: Path) -> None:
    folder = tmp_path / "card"
    folder.mkdir()
    for name in demo.STREAMS:
        rows = demo.true_track(name)
        video_text_track.write(
            folder / f"{name}.mp4", demo.DEMO / f"{name}.mp4", rows, dji_subtitles.brackets
        )
    shutil.copy(demo.DEMO / "terrain.tif", folder)
    shutil.copy(demo.DEMO / "camera.yaml", folder)
    draft = draft_of(folder, contents_of(folder))
    assert [s.telemetry for s in draft.streams] == [folder / "drone-1.mp4", folder / "drone-2.mp4"]
    assert [(s.height, s.gimbal) for s in draft.streams] == [("absolute", False)] * 2
    assert "FILL IN" not in mission_text(draft, folder)


def test_a_row_of_recordings_takes_the_subtitles_of_each(tmp_path: Path) -> None:
    folder = tmp_path / "card"
    folder.mkdir()
    rows = demo.true_track("drone-1")
    for k, name in enumerate(("DJI_0001", "DJI_0002")):
        began = datetime.fromtimestamp(rows.start_time_ns / 1e9 + 47.0 * k, UTC)
        with (
            av.open(str(demo.DEMO / "drone-1.mp4")) as read,
            av.open(str(folder / f"{name}.mp4"), "w") as written,
        ):
            video = read.streams.video[0]
            stream = written.add_stream_from_template(video)
            written.metadata["creation_time"] = began.isoformat()
            for packet in read.demux(video):
                if packet.dts is not None:
                    packet.stream = stream
                    written.mux(packet)
        later = replace(rows, start_time_ns=rows.start_time_ns + round(47e9 * k))
        dji_subtitles.write(folder / f"{name}.SRT", later, dji_subtitles.brackets)
    shutil.copy(demo.DEMO / "terrain.tif", folder)
    shutil.copy(demo.DEMO / "camera.yaml", folder)
    draft = draft_of(folder, contents_of(folder))
    assert [len(s.videos) for s in draft.streams] == [2]
    assert draft.streams[0].telemetry == (folder / "DJI_0001.SRT", folder / "DJI_0002.SRT")
    assert "file: [DJI_0001.SRT, DJI_0002.SRT]" in mission_text(draft, folder)


def test_a_videos_own_track_wins_unless_the_file_beside_it_matches_better(tmp_path: Path) -> None:
    folder = tmp_path / "card"
    folder.mkdir()
    rows = {name: demo.true_track(name) for name in demo.STREAMS}
    for name in demo.STREAMS:
        video_text_track.write(
            folder / f"{name}.mp4", demo.DEMO / f"{name}.mp4", rows[name], dji_subtitles.brackets
        )
    # beside one the same again; beside the other a file of which half is missing
    dji_subtitles.write(folder / "drone-1.srt", rows["drone-1"], dji_subtitles.brackets)
    dji_subtitles.write(folder / "drone-2.srt", rows["drone-2"], dji_subtitles.brackets)
    text = (folder / "drone-2.srt").read_text(encoding="utf-8").split("\n\n")
    (folder / "drone-2.srt").write_text("\n\n".join(text[: len(text) // 2]) + "\n\n", encoding="utf-8")
    draft = draft_of(folder, contents_of(folder))
    assert [s.telemetry for s in draft.streams] == [folder / "drone-1.mp4", folder / "drone-2.mp4"]
    assert set(draft.unused) == {folder / "drone-1.srt", folder / "drone-2.srt"}
    assert "own telemetry" in draft.unused[folder / "drone-1.srt"]


def test_a_folder_with_stills_and_a_video_becomes_a_mission_of_both(
    card: Path, small_mission: Path, quick_pool: None
) -> None:
    source = small_mission.parent
    photos = card / "DCIM/photos"
    photos.mkdir()
    (card / "DCIM/DJI_0007.MP4").unlink()
    (card / "DCIM/DJI_0001.SRT").unlink()
    shutil.copy(source / "drone-1.srt", card / "DCIM/DJI_0001.SRT")
    (card / "DCIM/DJI_0007.SRT").unlink()
    track = read_dji_srt(source / "drone-2.srt")
    with av.open(str(source / "drone-2.mp4")) as video:
        for k, frame in enumerate(video.decode(video=0)):
            if k % 20 or k >= len(track.times_s):
                continue
            taken = datetime.fromtimestamp(track.start_time_ns * 1e-9 + float(track.times_s[k]), UTC)
            xmp = {
                "RelativeAltitude": f"{track.relative_height_m[k]:+.3f}",
                "AbsoluteAltitude": f"{track.absolute_height_m[k]:+.3f}",
                "GimbalYawDegree": f"{np.degrees(track.yaw_rad[k]):+.2f}",
                "GimbalPitchDegree": f"{np.degrees(track.pitch_rad[k]):+.2f}",
                "GimbalRollDegree": "+0.00",
            }
            place = float(track.latitude_deg[k]), float(track.longitude_deg[k])
            image = frame.to_ndarray(format="rgb24")
            height_m = float(track.absolute_height_m[k])
            write_still(photos / f"DJI_{k:04}.JPG", image, taken, *place, height_m, xmp)
    result = init_mission(card, lambda *_: None)
    text = result.mission.read_text(encoding="utf-8")
    assert result.streams == 2
    assert result.to_fill == ()
    assert "- id: photos\n  stills: DCIM/photos\n  telemetry:\n    file: DCIM/photos\n" in text
    mission = load_mission(result.mission)
    assert [s.stills for s in mission.streams] == [None, photos]
    prepared = prepare(result.mission)
    assert [s.source.info.constant for s in prepared.streams] == [True, False]
    assert push_one_picture(prepared, plan(prepared)) == []


def test_stills_alone_are_a_mission_and_those_without_positions_are_named(tmp_path: Path) -> None:
    album = tmp_path / "album"
    album.mkdir()
    for k in range(6):
        Image.new("RGB", (64, 48)).save(album / f"{k}.jpg")
    contents = contents_of(tmp_path)
    assert contents.stills == ()
    assert "date" in contents.unused[album]

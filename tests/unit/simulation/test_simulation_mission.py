import json
from pathlib import Path

import av
import numpy as np
import pytest
import rasterio
import yaml
from pyproj import Transformer

from pipeline.config.camera import load_camera
from pipeline.config.mission import load_mission
from pipeline.config.scenario import load_scenario
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.ingest.telemetry.dji_srt import read_dji_srt
from pipeline.messages import CameraPose
from pipeline.simulation import mission_writer
from pipeline.simulation.mission_writer import simulate
from pipeline.simulation.rehearsal import rehearse

ROOT = Path(__file__).parents[3]
DEMO = ROOT / "configs" / "scenarios" / "demo.yaml"
FILES = {"camera.yaml", "mission.yaml", "terrain.tif", "drone-1.mp4", "drone-1.srt"}
TRUTH = {"people.geojson", "boxes-drone-1.json"}


def nothing(name, done, total):
    pass


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    """The demo made tiny: one drone, a small area, small pictures, a fifth of a second."""
    document = yaml.safe_load(DEMO.read_text())
    document["area"] = {"width": {"meters": 40}, "depth": {"meters": 40}}
    document["people"] |= {"places": 3, "walkers": 1, "half_hidden": 0, "apart": {"meters": 3}}
    document["camera"] = {"width": 160, "height": 96, "fx": 140.0, "fy": 140.0, "cx": 80.0, "cy": 48.0}
    document["flight"] |= {"drones": 1, "longest": {"seconds": 0.2}}
    document["surface_model"] = {"cell": {"meters": 0.5}, "margin": {"meters": 10}}
    document["recording"] |= {"preset": "ultrafast"}
    for key in ("inventory", "pool"):
        document["mission"][key] = str((DEMO.parent / document["mission"][key]).resolve())
    path = tmp_path_factory.mktemp("scenario") / "tiny.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


@pytest.fixture(scope="module")
def rehearsal(scenario):
    """Built once for all tests; only the workers of a pool build it anew."""
    built = rehearse(load_scenario(scenario))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mission_writer, "rehearse", lambda _: built)
        yield built


@pytest.fixture(scope="module")
def mission(scenario, rehearsal, tmp_path_factory):
    return simulate(scenario, tmp_path_factory.mktemp("out") / "mission", progress=nothing, workers=1).parent


def test_the_folder_has_all_files(mission):
    assert {p.name for p in mission.iterdir()} == FILES | {"truth"}
    assert {p.name for p in (mission / "truth").iterdir()} == TRUTH


def test_the_number_of_workers_changes_no_byte(scenario, mission, tmp_path):
    other = simulate(scenario, tmp_path / "mission", progress=nothing, workers=2).parent
    for name in sorted(FILES - {"mission.yaml"}) + [f"truth/{n}" for n in sorted(TRUTH)]:
        assert (mission / name).read_bytes() == (other / name).read_bytes(), name


def test_the_mission_and_the_camera_can_be_loaded(scenario, mission):
    loaded, wanted = load_mission(mission / "mission.yaml"), load_scenario(scenario)
    assert loaded.processing == wanted.mission.processing
    assert loaded.fusion == wanted.mission.fusion
    assert loaded.inventory.resolve() == wanted.mission.inventory.resolve()
    assert (loaded.streams[0].video, loaded.truth) == (
        mission / "drone-1.mp4",
        mission / "truth/people.geojson",
    )
    camera = loaded.streams[0].camera.file
    assert camera is not None
    assert load_camera(camera).fx == 140.0


def test_the_video_has_a_frame_for_each_cue(mission):
    with av.open(str(mission / "drone-1.mp4")) as container:
        stream = container.streams.video[0]
        pictures = sum(1 for _ in container.decode(stream))
        assert (stream.codec_context.name, stream.average_rate, pictures) == ("h264", 30, 6)
        assert stream.pix_fmt == "yuv420p"
    assert len(read_dji_srt(mission / "drone-1.srt").times_s) == 6


def test_the_surface_model_has_the_scene_s_height_at_each_cell_s_centre(mission, rehearsal):
    with rasterio.open(mission / "terrain.tif") as file:
        assert file.crs.to_epsg() == 32633
        heights, transform = file.read(1), file.transform
    rows, columns = (g.ravel() for g in np.mgrid[0 : heights.shape[0] : 7, 0 : heights.shape[1] : 7])
    x, y = rasterio.transform.xy(transform, rows, columns)
    east, north = Transformer.from_crs("EPSG:32633", rehearsal.frame.crs, always_xy=True).transform(x, y)
    wanted = rehearsal.scene.surface_height(np.asarray(east), np.asarray(north))
    assert heights[rows, columns] == pytest.approx(wanted, abs=2e-3)


def test_a_true_place_projects_to_the_true_box(mission, rehearsal):
    scenario = rehearsal.scenario
    boxes = json.loads((mission / "truth/boxes-drone-1.json").read_text())
    people = json.loads((mission / "truth/people.geojson").read_text())["features"]
    track, frame = read_dji_srt(mission / "drone-1.srt"), rehearsal.frame
    resting = {p["id"]: p["geometry"]["coordinates"] for p in people if p["geometry"]["type"] == "Point"}
    assert [image["frame_index"] for image in boxes["images"]] == list(range(0, 6, scenario.boxes_every))
    for note in boxes["annotations"]:
        if note["person_id"] not in resting:
            continue
        k = note["image_id"]
        angles = (track.yaw_rad[k], track.pitch_rad[k], track.roll_rad[k])
        camera = enu(frame, track.longitude_deg[k], track.latitude_deg[k], track.absolute_height_m[k])
        place = enu(frame, *resting[note["person_id"]])
        ((x, y),) = rehearsal.camera.project_enu(place[None], CameraPose(camera, enu_from_camera(*angles)))
        x0, y0, width, height = note["full_bbox"]
        assert x0 - 1 <= x <= x0 + width + 1
        assert y0 - 1 <= y <= y0 + height + 1


def enu(frame: LocalFrame, longitude, latitude, height):
    east, north = frame.enu_from_wgs84(np.asarray(latitude), np.asarray(longitude))
    return np.array([float(east), float(north), height])


def test_a_walker_s_truth_is_a_track_with_times(mission):
    people = json.loads((mission / "truth/people.geojson").read_text())["features"]
    assert [p["geometry"]["type"] for p in people] == ["Point", "Point", "LineString"]
    assert len(people[2]["geometry"]["coordinates"]) == len(people[2]["properties"]["times"])


def test_an_interruption_leaves_nothing(scenario, rehearsal, tmp_path):
    def interrupt(name, done, total):
        if name == "drone-1":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(scenario, tmp_path / "mission", progress=interrupt, workers=1)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_use_is_refused(scenario, tmp_path):
    (tmp_path / "note.txt").write_text("mine")
    with pytest.raises(InputError, match="in use"):
        simulate(scenario, tmp_path, progress=nothing)
    assert [p.name for p in tmp_path.iterdir()] == ["note.txt"]


@pytest.mark.parametrize("name", ["demo", "check-a", "check-b"])
def test_the_shipped_scenarios_are_valid(name):
    scenario = load_scenario(DEMO.with_name(f"{name}.yaml"))
    assert scenario.name == name
    assert scenario.people.places == 9


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("seed", 910_000, "900000"),
        ("start", "2026-06-14T09:30:00+02:00", "UTC"),
        ("area", {"width": {"meters": 5}, "depth": {"meters": 20}}, "20"),
        ("people", {"places": 9}, "nothing"),
        ("zoom", 2, "unknown key"),
    ],
)
def test_a_fault_is_named(tmp_path, key, value, said):
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(DEMO.read_text()) | {key: value}))
    with pytest.raises(InputError, match=said) as caught:
        load_scenario(path)
    assert key in str(caught.value)

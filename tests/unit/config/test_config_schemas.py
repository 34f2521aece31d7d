import math
from collections.abc import Callable
from pathlib import Path

import pytest
from pydantic import BaseModel

from pipeline.config.camera import load_camera
from pipeline.config.inventory import load_inventory
from pipeline.config.mission import load_mission
from pipeline.config.pool import load_pool
from pipeline.errors import InputError

Write = Callable[..., Path]
LOAD: dict[str, Callable[[Path], object]] = {
    "mission": load_mission,
    "pool": load_pool,
    "inventory": load_inventory,
    "camera": load_camera,
}


def test_paths_of_a_mission_are_relative_to_its_file(write: Write, tmp_path: Path) -> None:
    mission = load_mission(write("mission"))
    assert mission.terrain.files == (tmp_path / "dsm.tif",)
    assert mission.streams[0].video == tmp_path / "drone-1.mp4"
    assert mission.streams[0].telemetry.file == tmp_path / "drone-1.srt"
    assert mission.truth == tmp_path / "people.geojson"


def test_units_become_si(write: Write) -> None:
    mission = load_mission(write("mission"))
    assert mission.streams[0].telemetry.time_offset == pytest.approx(0.04)
    assert mission.processing.bitrates == (1e6, 4e6)
    pool = load_pool(write("pool"))
    assert pool.detectors[0].memory == 300e6
    assert pool.detectors[0].times[0].maximum == pytest.approx(0.03)


def test_a_link_may_be_without_limit(write: Write) -> None:
    assert load_inventory(write("inventory")).links[1].bandwidth == math.inf


def test_equal_machines_have_names_of_their_own(write: Write) -> None:
    assert load_inventory(write("inventory")).sites[0].machines[0].names == ("laptop", "laptop-2")


def test_a_model_is_relative_to_its_pool(write: Write, tmp_path: Path) -> None:
    assert load_pool(write("pool")).detectors[0].model == tmp_path / "nano.onnx"


def test_a_camera_without_distortion_has_none(write: Write) -> None:
    assert not load_camera(write("camera")).distortion.any()


def test_records_are_frozen(write: Write) -> None:
    mission = load_mission(write("mission"))
    assert isinstance(mission, BaseModel)
    with pytest.raises(ValueError, match="frozen"):
        mission.name = "other"  # type: ignore[misc]


@pytest.mark.parametrize(
    ("kind", "old", "new", "where", "expected"),
    [
        ("mission", "{milliseconds: 40}", "{seconds: .inf}", "time_offset", "at most"),
        ("mission", "{milliseconds: 40}", "40", "time_offset", "{seconds: NUMBER}"),
        (
            "mission",
            "width_min: {meters: 0.3}",
            "width_min: {meters: 3}",
            "width_min",
            "less than width_max, 2 m",
        ),
        (
            "mission",
            "height_max: {meters: 2}",
            "height_max: {meters: 0.3}",
            "height_min",
            "less than height_max",
        ),
        ("mission", "threshold: 0.9", "threshold: 0.99", "fusion.threshold", "less than clamp_max, 0.971"),
        ("mission", "threshold: 0.9", "threshold: 0.5", "fusion.threshold", "more than 0.5"),
        ("mission", "threshold: 0.9", "threshold: 0.9\n  clamp_min: 0.6", "clamp_min", "less than 0.5"),
        ("mission", "positive_max: 0.4", "positive_max: 0.6", "positive_max", "less than or equal to 0.5"),
        ("mission", "[{mbps: 1}, {mbps: 4}]", "[]", "bitrates", "at least 1 item"),
        ("mission", "[{mbps: 1}, {mbps: 4}]", "[{mbps: .inf}]", "bitrates.0", "at most"),
        ("mission", "[{mbps: 1}, {mbps: 4}]", "[{mbps: 0}]", "bitrates.0", "at least"),
        ("mission", "frame_rate: {hertz: 10}", "frame_rate: {hertz: 0}", "frame_rate", "at least"),
        (
            "pool",
            "maximum: {milliseconds: 30}",
            "maximum: {milliseconds: 3}",
            "maximum",
            "at least the mean, 0.02 s",
        ),
        ("pool", "{bitrate: {mbps: 4}", "{bitrate: {kbps: 1000}", "accuracy.1", "every bitrate once"),
        ("camera", "cx: 512.0", "cx: .nan", "cx", "a finite number"),
        ("camera", "fx: 900.0", "fx: -900.0", "fx", "greater than 0"),
        ("camera", "cy: 288.0", "cy: 288.0\ndistortion: [0, 0]", "distortion", "4 (k1, k2, p1, p2)"),
    ],
)
def test_a_value_out_of_its_range_is_named(
    write: Write, kind: str, old: str, new: str, where: str, expected: str
) -> None:
    with pytest.raises(InputError) as caught:
        LOAD[kind](write(kind, old, new))
    assert where in caught.value.where
    assert expected in caught.value.expected


@pytest.mark.parametrize(("kind", "what"), [("mission", "stream"), ("pool", "detector")])
def test_a_name_comes_once(write: Write, kind: str, what: str) -> None:
    path = write(kind)
    text = path.read_text()
    start = text.index("  - id:")
    end = text.index("inventory:") if kind == "mission" else len(text)
    path.write_text(text[:end] + text[start:end] + text[end:])
    with pytest.raises(InputError, match=f"every {what} once"):
        LOAD[kind](path)


FURTHER = """\
  further_classes:
    - id: 1
      name: boat
      significant_point: center
      object_size:
        width_min: {meters: 1}
        width_max: {meters: 9}
        height_min: {meters: 1}
        height_max: {meters: 9}
"""


def test_persons_are_the_first_class_and_others_follow(write: Write) -> None:
    person, boat = load_mission(write("mission", "fusion:\n", "fusion:\n" + FURTHER)).fusion.classes
    assert (person.id, person.name, person.typical_height) == (0, "person", 1.7)
    assert (boat.id, boat.name, boat.object_size.width_max) == (1, "boat", 9.0)


@pytest.mark.parametrize(("old", "new"), [("id: 1", "id: 0"), ("name: boat", "name: person")])
def test_a_class_that_comes_twice_is_refused(write: Write, old: str, new: str) -> None:
    path = write("mission", "fusion:\n", "fusion:\n" + FURTHER.replace(old, new))
    with pytest.raises(InputError, match=r"further_classes\.0.* again; expected every"):
        load_mission(path)


def test_a_mesh_has_an_origin_on_earth(write: Write) -> None:
    mesh = "{{file: hill.ply, origin: {{latitude: {{degrees: {}}}, longitude: {{degrees: 8}}}}}}"
    origin = load_mission(write("mission", "{file: dsm.tif}", mesh.format(47.5))).terrain.origin
    assert origin is not None
    assert origin.latitude == pytest.approx(math.radians(47.5))
    with pytest.raises(InputError, match=r"terrain\.origin\.latitude: found 97\.5 degrees"):
        load_mission(write("mission", "{file: dsm.tif}", mesh.format(97.5)))


def test_a_drone_may_only_film_but_somebody_must_look(write: Write) -> None:
    path = write("inventory")
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("sites:\n", "sites:\n  - id: drone-1\n"), encoding="utf-8")
    assert load_inventory(path).sites[0].machines == ()
    path.write_text("sites:\n  - id: drone-1\n", encoding="utf-8")
    with pytest.raises(InputError, match="no machine at any site"):
        load_inventory(path)

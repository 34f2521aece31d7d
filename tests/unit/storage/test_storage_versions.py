"""What we write says what it is; what is of another version is refused by name, what is older is read."""

import json
from pathlib import Path

import pytest

from pipeline.allocation.plan import Plan, plan_from_json
from pipeline.config.camera import load_camera
from pipeline.errors import InputError
from pipeline.storage.versions import VERSIONS, require_version, stamp

CAMERA = "width: 64\nheight: 48\nfx: 50\nfy: 50\ncx: 32\ncy: 24\n"


@pytest.mark.parametrize("kind", VERSIONS)
def test_a_stamp_is_accepted_and_so_is_a_document_from_before_stamps(kind: str) -> None:
    require_version(stamp(kind), kind, "file")
    require_version({}, kind, "file")


@pytest.mark.parametrize("change", [{"version": 2}, {"version": "1"}, {"format": "searchlight map"}])
def test_another_version_or_kind_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(InputError, match="searchlight plan of version 1"):
        require_version(stamp("plan") | change, "plan", "plan.json")


def test_a_plan_of_another_version_is_refused() -> None:
    plan = {"status": "optimal", "assignments": [], "objective": 1.0, "bound": 1.0, "gap": 0.0}
    rest = {"detectors_per_stream": 2, "solve_s": 0.1, "variables": 1, "constraints": 1}
    names = Plan.__dataclass_fields__
    document = {"plan": {name: (plan | rest).get(name, 0) for name in names}}
    assert plan_from_json(json.dumps(stamp("plan") | document), "x").status == "optimal"
    with pytest.raises(InputError, match="version 7"):
        plan_from_json(json.dumps(stamp("plan") | document | {"version": 7}), "x")


def test_a_yaml_file_may_say_its_version(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text("version: 1\n" + CAMERA, encoding="utf-8")
    assert load_camera(path).width == 64


@pytest.mark.parametrize("version", ["2", "'1'", "true", "null", "1.0"])
def test_a_yaml_file_of_another_version_is_refused_with_its_line(tmp_path: Path, version: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(CAMERA + f"version: {version}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"camera\.yaml:7 version: found .*; expected 1, the format"):
        load_camera(path)

"""A mission needs no fusion section: cells follow from the errors, and comments say what each key means."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import pytest
import yaml

from pipeline.config.commented import commented_mission
from pipeline.config.fusion import Fusion
from pipeline.config.mission import load_mission
from pipeline.errors import InputError

ROOT = Path(__file__).resolve().parents[3]
DEMO = ROOT / "configs/missions/demo/mission.yaml"


def written(path: Path, change: dict[str, object]) -> Path:
    document = yaml.safe_load(DEMO.read_text()) | change
    path.write_text(yaml.safe_dump({k: v for k, v in document.items() if v is not None}))
    return path


def test_a_mission_without_a_fusion_section_is_the_default_one(tmp_path: Path) -> None:
    fusion = load_mission(written(tmp_path / "m.yaml", {"fusion": None})).fusion
    assert fusion == Fusion()
    assert (fusion.cell_size, fusion.cluster_distance, fusion.threshold, fusion.lateness) == (
        0.5,
        2.0,
        0.7,
        2.0,
    )
    assert (fusion.object_size.width_min, fusion.object_size.height_max) == (0.2, 2.2)


@pytest.mark.parametrize(
    ("errors", "cell_m", "cluster_m"),
    [
        ({}, 0.5, 2.0),
        ({"position_noise": {"meters": 0.01}, "attitude_noise": {"degrees": 0.05}}, 0.5, 2.0),
        ({"position_noise": {"meters": 0.5}}, 1.25, 2.5),
        ({"position_noise": {"meters": 1.5}}, 2.0, 4.0),
        ({"attitude_noise": {"degrees": 0.5}}, 1.0, 2.0),
        ({"position_bias": {"meters": 5}}, 0.5, 2.0),  # a bias moves all looks together
    ],
)
def test_cells_follow_from_the_noise(
    tmp_path: Path, errors: dict[str, object], cell_m: float, cluster_m: float
) -> None:
    fusion = load_mission(written(tmp_path / "m.yaml", {"fusion": {"uncertainty": errors}})).fusion
    assert (fusion.cell_size, fusion.cluster_distance) == (cell_m, cluster_m)


def test_what_is_said_counts(tmp_path: Path) -> None:
    given = {"cell_size": {"meters": 1.0}, "cluster_distance": {"meters": 5.0}}
    fusion = load_mission(written(tmp_path / "m.yaml", {"fusion": given})).fusion
    assert (fusion.cell_size, fusion.cluster_distance) == (1.0, 5.0)
    only_cells = load_mission(written(tmp_path / "m.yaml", {"fusion": {"cell_size": {"meters": 1.5}}})).fusion
    assert only_cells.cluster_distance == 3.0
    with pytest.raises(InputError, match="cell_size"):
        load_mission(written(tmp_path / "m.yaml", {"fusion": {"cell_size": {"meters": float("nan")}}}))


def test_the_demos_mission_carries_comments() -> None:
    text = DEMO.read_text()
    keys = set(re.findall(r"^ *(?:- )?(\w+):", text, re.MULTILINE))
    lines = text.splitlines()
    uncommented = set(keys)
    for above, line in itertools.pairwise(lines):
        key = re.match(r"^ *(?:- )?(\w+):", line)
        if key and above.lstrip().startswith("#"):
            uncommented.discard(key[1])
    units = {"meters", "seconds", "degrees", "hertz", "mbps", "pixels", "hours"}
    assert uncommented - units <= {"telemetry"}


def test_comments_change_nothing_and_stand_above_their_key_once(tmp_path: Path) -> None:
    document = yaml.safe_load(DEMO.read_text())
    text = commented_mission(document, "A head.")
    assert yaml.safe_load(text) == document
    assert text.splitlines()[0] == "# A head."
    cell = text.splitlines().index("  cell_size:")
    assert text.splitlines()[cell - 1] == "  # Side of the map's cells."
    assert text.count("One file, or a list of one for each recording") == 1  # of two streams
    assert max(map(len, text.splitlines())) <= 110
    assert "`" not in text

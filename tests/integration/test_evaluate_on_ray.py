"""The grid's units on a real local Ray give what one process gives."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from actors.evaluation_cluster import on_cluster
from pipeline.errors import InputError
from pipeline.evaluation.measuring.unit import Condition, Model, Unit
from pipeline.evaluation.measuring.work_unit import work

NANO = Path(__file__).resolve().parents[2] / "configs/detectors/nano.onnx"

pytestmark = [pytest.mark.ray, pytest.mark.timeout(240)]


@pytest.fixture(autouse=True)
def in_this_process_alone() -> Iterator[None]:
    """Ray runs in the tests' own process here: what it leaves behind is not for the tests that follow."""
    environment, folders = dict(os.environ), set(Path("/tmp").glob("searchlight-*"))
    yield
    os.environ.clear()
    os.environ.update(environment)
    for folder in set(Path("/tmp").glob("searchlight-*")) - folders:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.mark.slow
def test_units_on_ray_give_what_one_process_gives_and_their_errors_come_back(small_mission: Path) -> None:
    unit = Unit(
        sequence="drone-1",
        files=(small_mission.parent / "drone-1.mp4",),
        is_video=True,
        frame_rate_hz=30.0,
        kept=tuple(range(16)),
        looked={0: 0, 15: 5},
        size=(512, 288),
        condition=Condition("h264", 250e3),
        keyframe_interval=60,
        models=(Model("nano", NANO, "0" * 64),),
        score_cutoff=0.05,
    )
    units = [unit, replace(unit, condition=Condition())]
    here = {u.condition: result for u, result in zip(units, work(tuple(units)), strict=True)}
    for done, result in on_cluster(None)(units):
        alone = here[done.condition]
        assert result.total_bytes == alone.total_bytes
        np.testing.assert_array_equal(result.found["nano"].boxes_px, alone.found["nano"].boxes_px)
        np.testing.assert_array_equal(result.found["nano"].score, alone.found["nano"].score)
        del here[done.condition]
    assert not here
    absent = replace(unit, files=(small_mission.parent / "absent.mp4",))
    with pytest.raises(InputError, match=r"absent.mp4: found no file"):
        list(on_cluster(None)([absent]))

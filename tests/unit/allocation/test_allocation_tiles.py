"""The allocation chooses between a network on the frame and on tiles, by what both cost and find."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.allocation.build import build_problem
from pipeline.allocation.decomposed import solve
from pipeline.config.inventory import Inventory
from pipeline.config.pool import Pool
from pipeline.config.processing import Processing


def row(name: str, accuracy: float, milliseconds: float, megabytes: float, **changes) -> dict:
    return {
        "id": name,
        "model": "net.onnx",
        "memory": {"megabytes": megabytes},
        "accuracy": [{"bitrate": {"mbps": 20}, "accuracy": accuracy}],
        "times": [{"machine": "pc", "mean": {"milliseconds": milliseconds}, "threads": 1}],
    } | changes


#: an example, not a measurement: a small network on tiles that finds more than a large one on the whole frame
POOL = Pool.model_validate(
    {
        "detectors": [
            row("small-tiled", 0.90, 230, 90, tiles={"size": [1024, 576], "overlap": 0.25}),
            row(
                "small-tiled-2",
                0.90,
                130,
                100,
                tiles={"size": [1024, 576], "overlap": 0.25},
                times=[{"machine": "pc", "mean": {"milliseconds": 130}, "threads": 2}],
            ),
            row("large-frame", 0.30, 60, 70),
        ]
    }
)


def planned(rate_hz: float, memory_mb: float):
    processing = Processing.model_validate(
        {
            "frame_rate": {"hertz": rate_hz},
            "max_processing_time": {"seconds": 1},
            "bitrates": [{"mbps": 20}],
            "detectors_per_stream": 1,
        }
    )
    machine = {"id": "m", "type": "pc", "memory": {"megabytes": memory_mb}}
    inventory = Inventory.model_validate({"sites": [{"id": "drone", "machines": [machine]}]})
    problem = build_problem({"v": "drone"}, processing, inventory, POOL, where=Path("mission.yaml"))
    plan = solve(problem, time_limit_s=20.0)
    assert plan.status == "optimal"
    return plan


@pytest.mark.parametrize(
    ("rate_hz", "memory_mb", "chosen"),
    [
        (2.0, 200.0, "tiles"),  # half a second for each frame: there is time for tiles
        (10.0, 200.0, "frame"),  # a tenth: there is not
        (2.0, 80.0, "frame"),  # and no memory
    ],
)
def test_tiles_are_taken_where_there_is_time_and_memory_for_them(rate_hz, memory_mb, chosen):
    (assignment,) = planned(rate_hz, memory_mb).assignments
    assert (assignment.setup.tiling is not None) == (chosen == "tiles")


def test_with_two_threads_tiles_are_taken_at_a_rate_at_which_one_is_too_slow():
    (assignment,) = planned(7.0, 200.0).assignments
    assert (assignment.pool_detector, assignment.setup.threads) == ("small-tiled-2", 2)

"""Limits that cannot hold together are refused when they are made."""

from __future__ import annotations

import math

import pytest

from actors.machine import MachineParams
from pipeline.link.params import LinkParams
from pipeline.link.rate_estimate import RateParams
from pipeline.mission.stages.radio_link import RadioParams


@pytest.mark.parametrize(
    "wrong",
    [
        {"connect_s": 0.0},
        {"kernel_bytes": -1},
        {"ack_bytes": 0},
        {"broken_s": math.inf},
        {"send_s": math.nan},
        {"heartbeat_s": 1.0},
        {"silence_s": 20.0},
        {"ack_s": 0.5},
    ],
)
def test_a_link_s_limits(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected"):
        LinkParams(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "wrong", [{"window_s": 0.1}, {"drained_s": 0.3}, {"least_s": 0.0}, {"burst_bytes": -1}]
)
def test_an_estimate_s_limits(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected 0 < drained_s"):
        RateParams(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [{"queue_bytes": 0}, {"end_s": 0.0}, {"stalled_s": -1.0}])
def test_a_radio_s_limits(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected at least one byte"):
        RadioParams(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [{"result_bytes": 0}, {"stalled_s": 0.0}])
def test_a_machine_s_limits(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected at least one byte"):
        MachineParams(**wrong)  # type: ignore[arg-type]

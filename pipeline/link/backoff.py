"""How long to wait before a connection is tried again. Pure: the attempt and the chance are arguments."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class BackoffParams:
    """first_s: before the first attempt. most_s: the longest wait. growth: of each wait over the one before, >= 1.

    jitter: share of each wait that is left to chance, 0..1: drones that lost one station must not come back in step.
    """

    first_s: float = 0.1
    most_s: float = 2.0
    growth: float = 2.0
    jitter: float = 0.5

    def __post_init__(self) -> None:
        if not (
            0.0 < self.first_s <= self.most_s < math.inf and self.growth >= 1.0 and 0.0 <= self.jitter <= 1.0
        ):
            raise ValueError(f"{self}; expected 0 < first_s <= most_s, growth >= 1, jitter in 0..1")


def wait_s(params: BackoffParams, attempt: int, chance: float) -> float:
    """Seconds before an attempt, from 0. chance: uniform in 0..1, drawn by the caller."""
    exponent = min(
        attempt, math.ceil(math.log(params.most_s / params.first_s, max(params.growth, 1.0 + 1e-9))) + 1
    )
    whole_s = min(params.most_s, params.first_s * params.growth**exponent)
    return whole_s * (1.0 - params.jitter * chance)

"""Errors of a drone's telemetry: slowly wandering, as those of satellite positioning and gyroscopes are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.config.scenario import PoseNoise
from pipeline.messages import FloatArray
from pipeline.simulation.flight import Flight


def disturbed(flight: Flight, noise: PoseNoise, rng: np.random.Generator) -> Flight:
    """The flight as its telemetry tells it: at each time the pose of time_offset later, and errors."""
    wander = gauss_markov(rng, flight.times_s, noise.correlation_time, 6)
    late = flight.times_s + noise.time_offset
    return replace(
        flight,
        positions_enu=_at(late, flight.times_s, flight.positions_enu) + noise.position * wander[:, :3],
        angles_rad=_at(late, flight.times_s, flight.angles_rad) + noise.attitude * wander[:, 3:],
    )


def gauss_markov(
    rng: np.random.Generator, times_s: FloatArray, correlation_time_s: float, channels: int
) -> FloatArray:
    """First-order processes (N, channels) of deviation 1 and correlation exp(-|dt| / correlation_time_s)."""
    values = rng.standard_normal((len(times_s), channels))
    for i in range(1, len(times_s)):
        kept = np.exp(-(times_s[i] - times_s[i - 1]) / correlation_time_s)
        values[i] = kept * values[i - 1] + np.sqrt(1.0 - kept**2) * values[i]
    return values


def _at(wanted_s: FloatArray, times_s: FloatArray, columns: FloatArray) -> FloatArray:
    """Columns (N, 3) at other times; the first and the last row hold before and after."""
    return np.stack([np.interp(wanted_s, times_s, column) for column in columns.T], axis=1)

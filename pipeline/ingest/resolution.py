"""How finely telemetry is written: a position to four decimals is known to metres, whatever the receiver knew."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pipeline.config.telemetry import Telemetry
from pipeline.ingest.finding import Finding
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory import Trajectory, widened
from pipeline.messages import FloatArray

_METERS_PER_DEGREE = 111_320.0
#: of a quantity that is cut into steps: its error is spread evenly over a step
_SD_PER_STEP = 1.0 / math.sqrt(12.0)
_FINEST_DEGREES, _FINEST_METERS = 7, 2
#: heights of fewer values than this are those of a hover, and tell nothing of how they are written
_FEWEST_HEIGHTS = 3
#: what widens a deviation by less than this share is not worth a word
_WORTH = 0.05
#: half axes of an ellipse that holds 95 %, in standard deviations of one axis
_HALF_AXIS_95 = 2.45
#: people lie closer together than this; a place that is not known so well may be that of another
_COARSE_M = 5.0


def with_resolution(
    trajectory: Trajectory, track: Track, telemetry: Telemetry
) -> tuple[Trajectory, list[Finding]]:
    """The trajectory whose deviations include how coarsely its track is written; and what there is to say of it.

    To what the telemetry states, or else the mission's position_bias and height_bias, the error of a step is added.
    Deviations that it does not widen by a twentieth stay as they are.
    """
    degrees = _step(track.latitude_deg, track.longitude_deg, finest=_FINEST_DEGREES)
    relative = telemetry.height == "relative"
    heights = track.relative_height_m if relative else track.absolute_height_m
    metres = _step(heights, finest=_FINEST_METERS) if len(np.unique(heights)) >= _FEWEST_HEIGHTS else 0.0
    steps_m = np.array([degrees * _METERS_PER_DEGREE, metres])
    before = widened(trajectory.sds[:, :2], trajectory.mission_sds[:2], 0.0)
    after = widened(trajectory.sds[:, :2], trajectory.mission_sds[:2], steps_m * _SD_PER_STEP)
    worth = [bool(wider.any()) for wider in (after > (1.0 + _WORTH) * before).T]
    if not any(worth):
        return trajectory, []
    sds = trajectory.sds.copy()
    sds[:, :2] = np.where(worth, after, sds[:, :2])
    return replace(trajectory, sds=sds), _findings(
        str(telemetry.file), steps_m, worth, float(after[:, 0].max())
    )


def _findings(where: str, steps_m: FloatArray, worth: list[bool], horizontal_sd_m: float) -> list[Finding]:
    named = [
        f"{name} in steps of {step:.2g} m"
        for name, step, is_worth in zip(("positions", "heights"), steps_m.tolist(), worth, strict=True)
        if is_worth
    ]
    text = f"{' and '.join(named)}; the ellipses of places are as much larger"
    half_axis_m = _HALF_AXIS_95 * horizontal_sd_m
    if not worth[0] or half_axis_m < _COARSE_M:
        return [Finding("assumed", "resolution", where, text)]
    text += f": places are known to {half_axis_m:.0f} m (95 %), people closer together are not told apart"
    mend = "a log of the flight with more decimals (Airdata, Litchi: CSV)"
    return [Finding("warning", "resolution", where, text, mend=mend)]


def _step(*columns: FloatArray, finest: int) -> float:
    """The power of ten of which all values are multiples; 0 if it is finer than ``finest`` decimals."""
    values = np.concatenate([c[np.isfinite(c)] for c in columns])
    for decimals in range(finest + 1):
        scaled = values * 10.0**decimals
        if len(values) and (np.abs(scaled - np.round(scaled)) < 1e-6).all():
            return float(10.0**-decimals)
    return 0.0

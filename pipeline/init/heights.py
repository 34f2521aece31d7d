"""Which of a drone's two heights to use, by what the ground under its first sample says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pipeline.config.mission import Datum
from pipeline.ingest.track import Track

#: the take-off place may be a little away from the first sample, and barometers drift
_AGREES_M = 5.0


@dataclass(frozen=True, slots=True)
class HeightChoice:
    """height, height_datum: for the mission file. reason: in words."""

    height: Literal["absolute", "relative"]
    height_datum: Datum | None
    reason: str


def choose_height(
    track: Track, ground_m: float | None, terrain_datum: Datum, undulation_m: float
) -> HeightChoice:
    """ground_m: of the terrain under the first sample, None if unknown. undulation_m: geoid above ellipsoid.

    The take-off point is where the absolute and the relative height differ; where that is the ground, the
    absolute heights are right, and their datum is the one that makes it so. Else the relative ones are used.
    """
    has_absolute = bool(np.isfinite(track.absolute_height_m).any())
    has_relative = bool(np.isfinite(track.relative_height_m).any())
    if not has_relative:
        return HeightChoice("absolute", track.height_datum, "the telemetry has no other height")
    if not has_absolute:
        return HeightChoice(
            "relative", None, "the telemetry has no other height; take-off at the first sample"
        )
    takeoff_m = float(np.nanmedian(track.absolute_height_m - track.relative_height_m))
    if ground_m is None:
        return HeightChoice("absolute", track.height_datum, "no ground is known that would say better")
    other: Datum = "geoid" if terrain_datum == "ellipsoid" else "ellipsoid"
    sign = 1.0 if terrain_datum == "ellipsoid" else -1.0
    off = {terrain_datum: takeoff_m - ground_m, other: takeoff_m + sign * undulation_m - ground_m}
    datum = track.height_datum or min(off, key=lambda name: abs(off[name]))
    if abs(off[datum]) <= _AGREES_M:
        reason = f"above the {datum}, take-off is {off[datum]:+.1f} m from the ground under the first sample"
        return HeightChoice("absolute", datum, reason)
    reason = (
        f"absolute heights would put take-off {off[datum]:+.1f} m from the ground under the first sample, "
        "so heights count from that ground"
    )
    return HeightChoice("relative", None, reason)

"""Which of a drone's two heights to use, by what the ground under its first sample says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pipeline.config.terrain import Datum
from pipeline.ingest.track import Track

#: the take-off place may be a little away from the first sample, and barometers drift
_AGREES_M = 5.0
#: no drone that films people is higher above its take-off (DJI's own limit is 500 m)
_HIGHEST_M = 500.0


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
    if track.height_is_either:
        return _either(track, ground_m)
    if ground_m is None:
        return HeightChoice("absolute", track.height_datum, "no ground is known that would say better")
    off_m = _off_ground(takeoff_m - ground_m, terrain_datum, undulation_m)
    nearest, _ = min(off_m.items(), key=lambda item: abs(item[1]))
    datum = track.height_datum or nearest
    if abs(off_m[datum]) <= _AGREES_M:
        reason = (
            f"above the {datum}, take-off is {off_m[datum]:+.1f} m from the ground under the first sample"
        )
        return HeightChoice("absolute", datum, reason)
    reason = (
        f"absolute heights would put take-off {off_m[datum]:+.1f} m from the ground under the first sample, "
        "so heights count from that ground"
    )
    return HeightChoice("relative", None, reason)


def _either(track: Track, ground_m: float | None) -> HeightChoice:
    """Of one height that the file does not call absolute or relative: by which of both can be."""
    known = track.absolute_height_m[np.isfinite(track.absolute_height_m)]
    if float(known.max()) > _HIGHEST_M:
        reason = f"as heights above take-off they would reach {known.max():.0f} m"
        return HeightChoice("absolute", track.height_datum, reason)
    if ground_m is not None and float(known[0]) < ground_m - _AGREES_M:
        reason = f"above the datum the drone would be {ground_m - known[0]:.0f} m under the ground at its first sample"
        return HeightChoice("relative", None, reason)
    reason = "the telemetry does not say what they are above, and both can be: relative, if they are above take-off"
    return HeightChoice("absolute", track.height_datum, reason)


def _off_ground(difference_m: float, terrain_datum: Datum, undulation_m: float) -> dict[Datum, float]:
    """Take-off above the ground, by the datum that the telemetry's heights may count from."""
    if terrain_datum == "ellipsoid":
        return {"ellipsoid": difference_m, "geoid": difference_m + undulation_m}
    return {"geoid": difference_m, "ellipsoid": difference_m - undulation_m}

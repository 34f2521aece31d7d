"""Telemetry samples, as a file gives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.config.terrain import Datum
from pipeline.messages import FloatArray

#: what a file's dates are: UTC, the local time of an unknown zone, or absent
Clock = Literal["utc", "local", "unknown"]


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """N >= 1 samples; every array is float64 (N,), NaN where a sample lacks the value.

    start_time_ns: the date of times_s == times_s[0], ns since 1970 on ``clock``; 0 if the clock is unknown.
    times_s: increasing; since the video's first picture if tied_to_video, else on the file's own clock.
    latitude_deg, longitude_deg: WGS84. absolute_height_m: above height_datum, which is None where the file does
    not say it. relative_height_m: above the take-off point. yaw_rad, pitch_rad, roll_rad: the camera's, as in
    ``pipeline.geo.pose``; all NaN where the format has none.

    Absent (None) where the format has no such field: aircraft_yaw_rad, aircraft_pitch_rad, aircraft_roll_rad:
    the airframe's attitude. focal_length_35mm: equivalent to a picture 36 mm wide, digital zoom included.
    digital_zoom: where no focal length holds it; 1 is the whole picture.
    horizontal_sd_m (each axis), height_sd_m, attitude_sd_rad: standard deviations, stated or from the kind of
    fix; the horizontal one is infinite where the receiver has none. recording: 1 where the log says that the
    camera was recording, else 0.

    end_s: how long the last sample holds, on the clock of times_s; None: as long as samples usually do.
    camera_name: as the file calls the camera or the drone. left_out: samples not used, reason -> count;
    first_left_out: where the first of them stands. assumed: what the reader had to assume, a sentence each.
    """

    start_time_ns: int
    times_s: FloatArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    absolute_height_m: FloatArray
    relative_height_m: FloatArray
    yaw_rad: FloatArray
    pitch_rad: FloatArray
    roll_rad: FloatArray
    clock: Clock = "utc"
    tied_to_video: bool = True
    height_datum: Datum | None = None
    aircraft_yaw_rad: FloatArray | None = None
    aircraft_pitch_rad: FloatArray | None = None
    aircraft_roll_rad: FloatArray | None = None
    focal_length_35mm: FloatArray | None = None
    digital_zoom: FloatArray | None = None
    horizontal_sd_m: FloatArray | None = None
    height_sd_m: FloatArray | None = None
    attitude_sd_rad: FloatArray | None = None
    recording: FloatArray | None = None
    end_s: float | None = None
    camera_name: str | None = None
    left_out: Mapping[str, int] = field(default_factory=dict)
    first_left_out: Mapping[str, str] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()

    @property
    def height_is_either(self) -> bool:
        """Whether the file has one height and does not say what it is above: both columns then hold it."""
        known = bool(np.isfinite(self.relative_height_m).any())
        return known and np.array_equal(self.absolute_height_m, self.relative_height_m, equal_nan=True)

    @property
    def has_position(self) -> NDArray[np.bool_]:
        """Which samples say where the drone was (N,): by a fix, or without a word on it."""
        known = np.isfinite(self.latitude_deg) & np.isfinite(self.longitude_deg)
        return known if self.horizontal_sd_m is None else known & ~np.isinf(self.horizontal_sd_m)

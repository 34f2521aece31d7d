"""From the samples of a file, and what the mission says of them, to the camera's way in the map frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config.telemetry import FixedGimbal, Telemetry
from pipeline.config.terrain import Datum
from pipeline.config.uncertainty import Uncertainty
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.attitude import camera_on_aircraft
from pipeline.ingest.track import Clock, Track
from pipeline.ingest.trajectory import Trajectory, widened
from pipeline.messages import FloatArray

BoolArray = NDArray[np.bool_]

#: a course is that of at least so much way, metres: below it a fix only wanders
_COURSE_WAY_M = 1.0
#: wind and turns: how well the way of a drone tells where its nose points
_COURSE_SD_RAD = math.radians(8.0)
#: a video begins no farther than this from where the drone took off, metres, as far as nobody says
_TAKEOFF_WITHIN_M = 50.0
#: (latitude, longitude, degrees) -> height of the geoid above the ellipsoid, and its standard deviation, metres
Undulation = Callable[[float, float], tuple[float, float]]


def _nothing_stands_in(east: float, north: float) -> float:
    return 0.0


@dataclass(frozen=True)
class Ground:
    """What of the ground heights are told by. height_m(east, north): above the datum, NaN where unknown.

    extra_sd_m(east, north): how far the ground may be from it where something stands in for the surface model.
    """

    datum: Datum
    height_m: Callable[[float, float], float]
    undulation: Undulation | None = None
    extra_sd_m: Callable[[float, float], float] = _nothing_stands_in


def trajectory_of(
    track: Track,
    telemetry: Telemetry,
    frame: LocalFrame,
    ground: Ground,
    *,
    offset_s: float | None = None,
    angles: Track | None = None,
    uncertainty: Uncertainty | None = None,
    focal_reference_mm: float | None = None,
) -> Trajectory:
    """The way of the camera. angles: the track of ``telemetry.angles``, on the video's clock, if there is one.

    uncertainty: the mission's (absent: that of a mission which says nothing), for what the telemetry does not state.
    focal_reference_mm: equivalent focal length that the camera belongs to.
    offset_s: added to the track's times to get the video's; absent, the mission's time_offset. Raises InputError
    for a position, a height or an angle that nothing tells, with what to write.
    """
    offset_s = (telemetry.time_offset or 0.0) if offset_s is None else offset_s
    believed = uncertainty or Uncertainty()
    known = track.has_position
    if not known.any():
        raise _without_positions(track, telemetry)
    assumed = list(track.assumed)
    east, north = frame.enu_from_wgs84(track.latitude_deg[known], track.longitude_deg[known])
    up, height_sd_m = _heights(track, telemetry, known, (float(east[0]), float(north[0])), ground, assumed)
    times_s = track.times_s[known] + offset_s
    way = np.stack([east, north], axis=1)
    angles_rad, course_sd_rad = _angles(track, telemetry, known, times_s, way, angles, assumed)
    up_sd_m, attitude_sd_rad = _or_nan(track.height_sd_m, known), _or_nan(track.attitude_sd_rad, known)
    if height_sd_m:
        up_sd_m = widened(up_sd_m, believed.height_bias, height_sd_m)
    if course_sd_rad:
        attitude_sd_rad = np.full(len(attitude_sd_rad), course_sd_rad)
    sds = np.stack([_or_nan(track.horizontal_sd_m, known), up_sd_m, attitude_sd_rad], axis=1)
    whole = np.isfinite(up) & np.isfinite(angles_rad).all(axis=1)
    if not whole.any():
        raise InputError(telemetry.file, "no sample with position, height and angles", "one at least")
    clock, start_ns = _clock(track, telemetry, offset_s)
    return Trajectory(
        times_s[whole],
        np.column_stack([way, up])[whole],
        angles_rad[whole],
        sds[whole],
        _focal_scale(track, known, focal_reference_mm)[whole],
        _end_s(track, times_s[whole], offset_s),
        telemetry.longest_gap,
        start_ns,
        clock,
        tuple(assumed),
        np.array([believed.position_bias, believed.height_bias, believed.attitude_bias]),
        _takeoff_m(up, track, telemetry, known),
    )


def _without_positions(track: Track, telemetry: Telemetry) -> InputError:
    if np.isnan(track.latitude_deg).all():
        return InputError(telemetry.file, "telemetry without positions", "a file with latitude and longitude")
    return InputError(
        telemetry.file,
        f"{len(track.times_s)} samples, and the receiver has a fix in none of them",
        "positions from another file (telemetry.file; this one can still give telemetry.angles), or a mission "
        "without this stream",
    )


def _takeoff_m(up: FloatArray, track: Track, telemetry: Telemetry, known: BoolArray) -> float:
    """Height of the take-off above the terrain's datum: where the heights above it count from. NaN: there are none."""
    if track.height_is_either and telemetry.height == "absolute":
        return math.nan
    relative_m = track.relative_height_m[known]
    both = np.isfinite(up) & np.isfinite(relative_m)
    return float(np.median((up - relative_m)[both])) if both.any() else math.nan


def _clock(track: Track, telemetry: Telemetry, offset_s: float) -> tuple[Clock, int]:
    """What the dates count on, and the date of the video's time 0."""
    start_ns = track.start_time_ns - round((float(track.times_s[0]) + offset_s) * 1e9)
    if track.clock == "local" and telemetry.utc_offset is not None:
        return "utc", start_ns - round(telemetry.utc_offset * 1e9)
    return track.clock, start_ns


def _end_s(track: Track, times_s: FloatArray, offset_s: float) -> float:
    last_s = float(times_s[-1])
    if track.end_s is not None:
        return max(last_s, track.end_s + offset_s)
    return last_s + (0.5 * float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0)


def _heights(
    track: Track,
    telemetry: Telemetry,
    known: BoolArray,
    first_en: tuple[float, float],
    ground: Ground,
    assumed: list[str],
) -> tuple[FloatArray, float]:
    """Heights above the terrain's datum, h (ellipsoid) = H (geoid) + N (undulation), and what N adds to their error."""
    relative = telemetry.height == "relative"
    heights = _column(track, telemetry, assumed)[known]
    if relative and telemetry.takeoff_height is None:
        ground_m = ground.height_m(*first_en)
        if math.isnan(ground_m):
            latitude, longitude = float(track.latitude_deg[known][0]), float(track.longitude_deg[known][0])
            found = (
                f"heights above take-off, and no ground under the first sample ({latitude:.5f}, {longitude:.5f}, "
                f"{math.hypot(*first_en) / 1000.0:.1f} km from the middle of the map)"
            )
            raise InputError(
                telemetry.file, found, "telemetry.takeoff_height, or a terrain that reaches there"
            )
        relief_m = math.hypot(_relief_m(ground, first_en), ground.extra_sd_m(*first_en))
        assumed.append(
            f"take-off at the ground under the first sample, {ground_m:.1f} m above the {ground.datum}, to "
            f"{relief_m:.1f} m, as it rises and falls within {_TAKEOFF_WITHIN_M:.0f} m (telemetry.takeoff_height)"
        )
        return np.asarray(heights + ground_m), relief_m
    if relative and telemetry.takeoff_height is not None:
        heights = heights + telemetry.takeoff_height
    datum = telemetry.height_datum or (None if relative else track.height_datum)
    if datum is None:
        datum = ground.datum
        assumed.append(
            f"{telemetry.height} heights count from the {datum}, as the terrain's (telemetry.height_datum)"
        )
    if datum == ground.datum:
        return np.asarray(heights), 0.0
    undulation_m, sd_m = _undulation(track, telemetry, known, ground, datum, assumed)
    return np.asarray(heights + undulation_m * (1.0 if ground.datum == "ellipsoid" else -1.0)), sd_m


def _column(track: Track, telemetry: Telemetry, assumed: list[str]) -> FloatArray:
    """The heights (N,) that the mission asks for; NaN where a sample has none."""
    both = {"absolute": track.absolute_height_m, "relative": track.relative_height_m}
    heights = both.pop(telemetry.height)
    if np.isfinite(heights).any():
        return heights
    ((other, other_heights),) = both.items()
    if telemetry.height == "relative" and telemetry.flight_height is not None:
        assumed.append(f"all of the flight is {telemetry.flight_height:g} m above take-off")
        return np.full(len(heights), telemetry.flight_height)
    expected = "telemetry.height: relative and telemetry.flight_height, if it was flown at one height"
    if np.isfinite(other_heights).any():
        expected = f"telemetry.height: {other}"
    raise InputError(telemetry.file, f"telemetry without {telemetry.height} height", expected)


def _relief_m(ground: Ground, about_en: tuple[float, float]) -> float:
    """How far the ground about a place is from that below it, root of the mean square, metres."""
    angles = np.arange(16) * math.pi / 8.0
    heights = np.array(
        [
            ground.height_m(about_en[0] + r * math.sin(a), about_en[1] + r * math.cos(a))
            for r in (0.5 * _TAKEOFF_WITHIN_M, _TAKEOFF_WITHIN_M)
            for a in angles.tolist()
        ]
    )
    known = heights[np.isfinite(heights)] - ground.height_m(*about_en)
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0


def _undulation(
    track: Track,
    telemetry: Telemetry,
    known: BoolArray,
    ground: Ground,
    datum: Datum,
    assumed: list[str],
) -> tuple[float, float]:
    if telemetry.geoid_undulation is not None:
        return telemetry.geoid_undulation, 0.0
    if ground.undulation is None:
        found = f"heights above the {datum} and a terrain above the {ground.datum}"
        raise InputError(telemetry.file, found, "geoid_undulation in the stream's telemetry")
    value_m, sd_m = ground.undulation(
        float(track.latitude_deg[known][0]), float(track.longitude_deg[known][0])
    )
    assumed.append(f"the geoid is {value_m:.1f} m (sd {sd_m:.1f} m) above the ellipsoid, by a geoid model")
    return value_m, sd_m


def _angles(
    track: Track,
    telemetry: Telemetry,
    known: BoolArray,
    times_s: FloatArray,
    way: FloatArray,
    other: Track | None,
    assumed: list[str],
) -> tuple[FloatArray, float]:
    """Yaw, pitch and roll (N, 3) of the camera, NaN where nothing tells them; and the error of a yaw by course."""
    gimbal, mounting = telemetry.gimbal, telemetry.mounting
    if gimbal.pitch == "aircraft":
        return _on_airframe(track, telemetry, known), 0.0
    if other is not None and telemetry.angles is not None:
        own = (other.yaw_rad, other.pitch_rad, other.roll_rad)
        columns = [_at(times_s, other.times_s, values, telemetry.longest_gap) for values in own]
    else:
        columns = [track.yaw_rad[known], track.pitch_rad[known], track.roll_rad[known]]
    yaw, course_sd_rad = _yaw(columns[0], gimbal, track, known, way, telemetry)
    pitch = columns[1] if gimbal.pitch is None else np.full(len(times_s), gimbal.pitch)
    roll = columns[2] if gimbal.roll is None else np.full(len(times_s), gimbal.roll)
    if np.isnan(roll).all():
        roll = np.zeros(len(times_s))
        assumed.append("the camera is level sideways (telemetry.gimbal.roll)")
    examples = {"yaw": (yaw, "yaw: course"), "pitch": (pitch, "pitch: {degrees: -45}")}
    missing = [name for name, (values, _) in examples.items() if np.isnan(values).all()]
    if missing:
        example = ", ".join(examples[name][1] for name in missing)
        expected = f"a file with them (telemetry.angles), or telemetry.gimbal: {{{example}}}"
        raise InputError(telemetry.file, f"telemetry without gimbal {' and '.join(missing)}", expected)
    turned = np.stack(
        [yaw + mounting.yaw + telemetry.yaw_offset, pitch + mounting.pitch, roll + mounting.roll], axis=1
    )
    if course_sd_rad:
        assumed.append("the camera looks where the drone flies (gimbal.yaw: course), to 8 degrees")
    return turned, course_sd_rad


def _on_airframe(track: Track, telemetry: Telemetry, known: BoolArray) -> FloatArray:
    """Angles (N, 3) of a camera without a gimbal: it leans with the aircraft."""
    own = (track.aircraft_yaw_rad, track.aircraft_pitch_rad, track.aircraft_roll_rad)
    columns = [values[known] for values in own if values is not None]
    if len(columns) < 3:
        found = "gimbal.pitch: aircraft, and telemetry without the aircraft's attitude"
        raise InputError(telemetry.file, found, "gimbal.pitch: an angle from the horizon")
    aircraft = np.stack([columns[0] + telemetry.yaw_offset, *columns[1:]], axis=1)
    mounting = telemetry.mounting
    return camera_on_aircraft(
        aircraft, np.tile([mounting.yaw, mounting.pitch, mounting.roll], (len(aircraft), 1))
    )


def _yaw(
    own: FloatArray,
    gimbal: FixedGimbal,
    track: Track,
    known: BoolArray,
    way: FloatArray,
    telemetry: Telemetry,
) -> tuple[FloatArray, float]:
    if gimbal.yaw is None:
        return own, 0.0
    if gimbal.yaw == "course":
        return course(way), _COURSE_SD_RAD
    if gimbal.yaw == "aircraft":
        if track.aircraft_yaw_rad is None:
            found = "gimbal.yaw: aircraft, and telemetry without the aircraft's heading"
            raise InputError(telemetry.file, found, "gimbal.yaw: course, or an angle")
        return track.aircraft_yaw_rad[known], 0.0
    return np.full(len(own), gimbal.yaw), 0.0


def course(way: FloatArray) -> FloatArray:
    """The direction of flight (N,), radians clockwise from north, of positions (N, 2) east and north.

    The way is cut into legs of a metre or more, so that the wandering of a fix over a hovering drone is none; a
    course turns from the middle of a leg to the middle of the next one. All NaN for a drone that never moves a metre.
    """
    anchors = [0]
    for k in range(1, len(way)):
        if math.dist(way[k], way[anchors[-1]]) >= _COURSE_WAY_M:
            anchors.append(k)
    if len(anchors) == 1:
        return np.full(len(way), math.nan)
    ends = np.array(anchors)
    legs = np.diff(way[ends], axis=0)
    middles = 0.5 * (ends[1:] + ends[:-1])
    return np.asarray(np.interp(np.arange(len(way)), middles, np.unwrap(np.arctan2(legs[:, 0], legs[:, 1]))))


def _at(times_s: FloatArray, own_s: FloatArray, values_rad: FloatArray, longest_gap_s: float) -> FloatArray:
    """Angles of another clock at given times; NaN before, after and in gaps."""
    known = np.isfinite(values_rad)
    if not known.any():
        return np.full(len(times_s), math.nan)
    own_s, unwrapped = own_s[known], np.unwrap(values_rad[known])
    result = np.interp(times_s, own_s, unwrapped, left=math.nan, right=math.nan)
    after = np.clip(np.searchsorted(own_s, times_s), 1, max(len(own_s) - 1, 1))
    if len(own_s) > 1:
        result[own_s[after] - own_s[after - 1] > longest_gap_s] = math.nan
    return np.asarray(result)


def _focal_scale(track: Track, known: BoolArray, reference_mm: float | None) -> FloatArray:
    """Focal length over the one that the camera belongs to; absent, the shortest: that of the widest view."""
    if track.focal_length_35mm is None:
        zoom = _or_nan(track.digital_zoom, known)
        return np.where(np.isfinite(zoom), zoom, 1.0)
    focal_mm = track.focal_length_35mm[known]
    if not np.isfinite(focal_mm).any():
        return np.ones(len(focal_mm))
    return np.where(np.isfinite(focal_mm), focal_mm / (reference_mm or float(np.nanmin(focal_mm))), 1.0)


def _or_nan(values: FloatArray | None, known: BoolArray) -> FloatArray:
    return np.full(int(known.sum()), math.nan) if values is None else values[known]

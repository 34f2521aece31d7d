"""From the samples of any format to a track: what cannot be used is left out, counted and named."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.config.terrain import Datum
from pipeline.errors import InputError
from pipeline.ingest.increasing import longest_increasing
from pipeline.ingest.track import Clock, Track
from pipeline.messages import FloatArray

IntArray = NDArray[np.int64]

#: fields of a sample: degrees, metres, millimetres of equivalent focal length
FIELDS = (
    "latitude", "longitude", "absolute_height", "relative_height", "yaw", "pitch", "roll",
    "aircraft_yaw", "aircraft_pitch", "aircraft_roll", "focal_length_35mm", "digital_zoom",
    "horizontal_sd", "height_sd", "attitude_sd", "recording",
)  # fmt: skip
_LIMITS = {
    "latitude": 90.0, "longitude": 180.0, "yaw": 360.0, "pitch": 140.0, "roll": 360.0,
    "aircraft_yaw": 360.0, "aircraft_pitch": 180.0, "aircraft_roll": 360.0,
    "absolute_height": 20_000.0, "relative_height": 20_000.0,
}  # fmt: skip
#: without one of these, if most samples have it, a sample was not written to its end
_ESSENTIAL = ("latitude", "longitude", "absolute_height", "relative_height", "yaw", "pitch", "roll")
#: nothing that films people from the air is faster, metres per second; a fix may wander so far, metres
_FASTEST_MPS, _WANDER_M = 150.0, 30.0
_METERS_PER_DEGREE = 111_320.0
#: dates in whole seconds beside times in milliseconds agree to so much, ns
_DATE_SLACK_NS = 1_500_000_000


@dataclass(frozen=True, slots=True)
class Sample:
    """where: file and line (or packet). time_s: on the track's clock. date_ns: ns since 1970, None without one.

    values: by the names of FIELDS. end_s: how long it holds; None: until the next one. has_fix: False where the
    receiver says that its position is none.
    """

    where: str
    time_s: float
    values: Mapping[str, float]
    date_ns: int | None = None
    end_s: float | None = None
    has_fix: bool = True


@dataclass
class LeftOut:
    """Samples that are not used: how many for each reason, and where the first one stands."""

    counts: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)

    def add(self, reason: str, where: str) -> None:
        """One more."""
        self.counts[reason] += 1
        self.first.setdefault(reason, where)

    def __str__(self) -> str:
        return ", ".join(f"{n} {reason} (first: {self.first[reason]})" for reason, n in self.counts.items())


def track_of(
    path: object,
    samples: Iterable[Sample],
    *,
    expected: str,
    clock: Clock,
    left_out: LeftOut | None = None,
    tied_to_video: bool = True,
    height_datum: Datum | None = None,
    camera_name: str | None = None,
    assumed: Sequence[str] = (),
) -> Track:
    """The track of the samples that can be used. expected: what the file should hold, for the error.

    left_out: what the reader left out already. Where no sample has a fix all are kept, with a horizontal error without
    bound: the file can still give angles. Raises InputError if no sample is left, with the reasons.
    """
    left_out = left_out or LeftOut()
    all_samples, of_longitudes = _eastward(list(samples))
    kept = _plausible(all_samples, left_out)
    kept = _without_spikes(_in_order(kept, left_out), left_out) or _never_fixed(all_samples)
    if not kept:
        found = f"no usable sample ({left_out})" if left_out.counts else "no sample"
        raise InputError(path, found, _angles_in_degrees(all_samples) or expected)
    columns = _columns(kept)
    start_ns, of_dates = _start_ns(kept)
    return Track(
        start_ns or 0,
        np.array([s.time_s for s in kept]),
        columns["latitude"],
        columns["longitude"],
        columns["absolute_height"],
        columns["relative_height"],
        np.radians(columns["yaw"]),
        np.radians(columns["pitch"]),
        np.radians(columns["roll"]),
        clock="unknown" if start_ns is None else clock,
        tied_to_video=tied_to_video,
        height_datum=height_datum,
        aircraft_yaw_rad=_radians(columns["aircraft_yaw"]),
        aircraft_pitch_rad=_radians(columns["aircraft_pitch"]),
        aircraft_roll_rad=_radians(columns["aircraft_roll"]),
        focal_length_35mm=_present(columns["focal_length_35mm"]),
        digital_zoom=_present(columns["digital_zoom"]),
        horizontal_sd_m=_present(columns["horizontal_sd"]),
        height_sd_m=_present(columns["height_sd"]),
        attitude_sd_rad=_radians(columns["attitude_sd"]),
        recording=_present(columns["recording"]),
        end_s=kept[-1].end_s,
        camera_name=camera_name,
        left_out=dict(left_out.counts),
        first_left_out=dict(left_out.first),
        assumed=(*assumed, *of_longitudes, *of_dates),
    )


def _columns(samples: Sequence[Sample]) -> dict[str, FloatArray]:
    """(N,) of each field, NaN where a sample has none."""
    held = set().union(*(s.values for s in samples))
    unknown = np.full(len(samples), math.nan)
    return {
        name: np.array([s.values.get(name, math.nan) for s in samples]) if name in held else unknown
        for name in FIELDS
    }


def _eastward(samples: list[Sample]) -> tuple[list[Sample], list[str]]:
    """Longitudes from 0 to 360, as some writers count them, to those from -180 to 180; and what is to be said."""
    counted = [180.0 < s.values.get("longitude", 0.0) <= 360.0 for s in samples]
    if 2 * sum(counted) <= len(samples):
        return samples, []  # of a few it is the fault
    turned = [
        replace(s, values={**s.values, "longitude": s.values["longitude"] - 360.0}) if is_so else s
        for s, is_so in zip(samples, counted, strict=True)
    ]
    return turned, ["longitudes count from 0 to 360 degrees eastward"]


def _start_ns(samples: Sequence[Sample]) -> tuple[int | None, list[str]]:
    """The date of the first sample, None without any, by the dates of most samples; and what is to be said of it.

    A drone that finds its first satellites sets its clock, by seconds or by years.
    """
    dated = [
        (s, s.date_ns - round((s.time_s - samples[0].time_s) * 1e9)) for s in samples if s.date_ns is not None
    ]
    if not dated:
        return None, []
    usual_ns = sorted(start for _, start in dated)[len(dated) // 2]
    agreeing = [(s, start) for s, start in dated if abs(start - usual_ns) <= _DATE_SLACK_NS]
    odd = [s for s, start in dated if abs(start - usual_ns) > _DATE_SLACK_NS]
    text = (
        [f"{len(odd)} dates that the other {len(agreeing)} contradict are not used (first: {odd[0].where})"]
        if odd
        else []
    )
    return agreeing[0][1], text


def _angles_in_degrees(samples: Sequence[Sample]) -> str:
    """What to look at if every sample has an angle beyond what there is; empty otherwise."""
    latitudes = [abs(s.values["latitude"]) for s in samples if {"latitude", "longitude"} <= s.values.keys()]
    if latitudes and float(np.median(latitudes)) > _LIMITS["latitude"]:
        return _latitudes_in_degrees(float(np.median(latitudes)))
    for name in ("pitch", "yaw", "roll"):
        values = [s.values[name] for s in samples if name in s.values]
        if values and float(np.median(np.abs(values))) > _LIMITS[name]:
            return f"angles in degrees; {name} is about {float(np.median(values)):g}: tenths of a degree?"
    return ""


def _latitudes_in_degrees(usual: float) -> str:
    if usual > 1e7:
        return f"latitudes in degrees; they are about {usual:.3g}: ten millionths (unit: degE7)?"
    if usual > 360.0:
        return f"latitudes in degrees; they are about {usual:.7g}: metres of a projection (UTM)? Convert them to WGS84"
    return "latitudes of at most 90 degrees: are latitude and longitude exchanged?"


def _never_fixed(samples: Sequence[Sample]) -> list[Sample]:
    """Samples of a receiver that never had a fix: as it wrote them, and as sure as nothing."""
    without = [
        replace(s, has_fix=True, values=dict(s.values)) for s in samples if _fault(s, set()) == "no_fix"
    ]
    possible = [s for s in without if _fault(s, set()) in (None, "no_fix")]
    kept = _in_order(possible, LeftOut())
    return [replace(s, values={**s.values, "horizontal_sd": math.inf}) for s in kept]


def _plausible(samples: list[Sample], left_out: LeftOut) -> list[Sample]:
    """Those that are whole, with a fix, and possible."""
    with_fix = [s for s in samples if s.has_fix]
    filled = sum(1 for s in with_fix if s.values)
    usual = {name for name in _ESSENTIAL if 2 * sum(name in s.values for s in with_fix) > filled}
    kept = []
    for sample in samples:
        reason = _fault(sample, usual)
        if reason is None:
            kept.append(sample)
        else:
            left_out.add(reason, sample.where)
    return kept


def _fault(sample: Sample, usual: set[str]) -> str | None:
    values = sample.values
    if not sample.has_fix:
        return "no_fix"
    if not values:
        return "empty"
    # a sum is finite if all are; it costs a fifth of looking at each
    if not math.isfinite(sum(values.values())) and any(not math.isfinite(v) for v in values.values()):
        return "unreadable"
    if values.get("latitude") == 0.0 and values.get("longitude") == 0.0:
        return "no_fix"
    if not math.isfinite(sample.time_s) or _beyond_limits(values):
        return "impossible"
    return "incomplete" if not usual <= values.keys() else None


def _beyond_limits(values: Mapping[str, float]) -> bool:
    return any(abs(values[name]) > most for name, most in _LIMITS.items() if name in values)


def _in_order(samples: list[Sample], left_out: LeftOut) -> list[Sample]:
    """The most whose times increase. A few times far ahead are the fault, not all that follow them."""
    times_s = np.array([s.time_s for s in samples], np.float64)
    rows = longest_increasing(times_s)
    others = np.setdiff1d(np.arange(len(samples)), rows)
    repeated = np.isin(times_s[others], times_s[rows])
    for row, again in zip(others.tolist(), repeated.tolist(), strict=True):
        left_out.add("repeated" if again else "out_of_order", samples[row].where)
    return [samples[row] for row in rows]


def _without_spikes(samples: list[Sample], left_out: LeftOut) -> list[Sample]:
    """A position that no drone reaches from both of its neighbours is not where the drone was."""
    if len(samples) < 3 or not all({"latitude", "longitude"} <= s.values.keys() for s in samples):
        return samples
    latitude = np.array([s.values["latitude"] for s in samples])
    longitude = np.array([s.values["longitude"] for s in samples])
    times_s = np.array([s.time_s for s in samples])
    wide = math.cos(math.radians(float(np.median(latitude))))

    def too_far(i: IntArray, j: IntArray) -> NDArray[np.bool_]:
        turn = np.mod(longitude[j] - longitude[i] + 180.0, 360.0) - 180.0
        distance_m = np.hypot(latitude[j] - latitude[i], turn * wide) * _METERS_PER_DEGREE
        return np.asarray(distance_m > _WANDER_M + _FASTEST_MPS * np.abs(times_s[j] - times_s[i]))

    # neighbours on both sides; at the ends, the two that follow or go before
    n = np.arange(len(samples))
    one, other = n - 1, n + 1
    one[0], other[0] = 1, 2
    one[-1], other[-1] = n[-1] - 2, n[-1] - 1
    spikes = too_far(n, one) & too_far(n, other) & ~too_far(one, other)
    for sample in (s for s, is_spike in zip(samples, spikes.tolist(), strict=True) if is_spike):
        left_out.add("impossible", sample.where)
    return [s for s, is_spike in zip(samples, spikes.tolist(), strict=True) if not is_spike]


def _present(column: FloatArray) -> FloatArray | None:
    return None if np.isnan(column).all() else column


def _radians(column: FloatArray) -> FloatArray | None:
    present = _present(column)
    return None if present is None else np.radians(present)

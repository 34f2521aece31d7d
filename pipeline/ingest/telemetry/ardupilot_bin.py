"""ArduPilot's dataflash logs (``.bin``), as the autopilot writes them to its card.

Position: POS, the autopilot's estimate, else GPS, else AHR2. Attitude: ATT, else AHR2. Gimbal: MNT. Fix: GPS and GPA.
Heights are above sea level; POS has one above home too. Times count since boot; GPS gives the date.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.attitude import Attitudes
from pipeline.ingest.flight_log import Fixes, FlightLog, times_of_utc, track_of_log
from pipeline.ingest.samples import LeftOut
from pipeline.ingest.telemetry.binary_file import read_bytes
from pipeline.ingest.telemetry.dataflash import HEADER, Messages, messages_of
from pipeline.ingest.telemetry.mavlink_gimbal import heading_at
from pipeline.ingest.track import Track
from pipeline.messages import FloatArray

EXPECTED = "an ArduPilot dataflash log (.bin) with positions"
_WANTED = ("POS", "GPS", "GPA", "ATT", "AHR2", "MNT", "CAM")
#: 1980-01-06, where GPS time begins, and how far it is ahead of UTC, seconds (since 2017)
_GPS_EPOCH_S, _LEAP_S, _WEEK_S = 315_964_800.0, 18.0, 604_800.0


def is_ardupilot_bin(path: Path, head: bytes) -> bool:
    """Whether a file begins with a description of messages (FMT)."""
    return head[:2] == HEADER


def read_ardupilot_bin(telemetry: Telemetry) -> Track:
    """The samples of a log. Raises InputError if none can be used."""
    path, left_out = telemetry.file, LeftOut()
    kinds = messages_of(read_bytes(path, EXPECTED), _WANTED, path, left_out)
    assumed: list[str] = []
    source = next((name for name in ("POS", "GPS", "AHR2") if _has_positions(kinds.get(name))), None)
    if source is None:
        raise InputError(path, f"no message POS, GPS or AHR2 ({left_out or 'nothing damaged'})", EXPECTED)
    positions = _first_instance(kinds[source], source, assumed)
    gap_s = telemetry.longest_gap
    aircraft = _aircraft(kinds)
    gps = _first_instance(kinds["GPS"], "GPS", []) if _has_positions(kinds.get("GPS")) else None
    columns = {
        "latitude": positions.columns["Lat"],
        "longitude": positions.columns["Lng"],
        "absolute_height": positions.get("Alt"),
        "relative_height": positions.get("RelHomeAlt", "RelAlt"),
    }
    log = FlightLog(
        _times_s(positions),
        {name: column for name, column in columns.items() if column is not None},
        height_datum="geoid",
        aircraft=aircraft,
        gimbal=_gimbal(kinds, aircraft, gap_s, assumed),
        fixes=None if gps is None else _fixes(gps, kinds.get("GPA")),
        utc_offset_s=None if gps is None else _utc_offset_s(gps),
        left_out=left_out,
        assumed=assumed,
    )
    return track_of_log(path, log, EXPECTED, gap_s)


def _has_positions(messages: Messages | None) -> bool:
    return (
        messages is not None
        and {"Lat", "Lng"} <= messages.columns.keys()
        and messages.get("TimeUS", "TimeMS") is not None
    )


def _times_s(messages: Messages) -> FloatArray:
    """Seconds since boot. The oldest logs' GPS has the time of the week in TimeMS, and that since boot in T."""
    if "TimeUS" in messages.columns:
        return messages.columns["TimeUS"] * 1e-6
    return messages.columns["T" if "T" in messages.columns else "TimeMS"] * 1e-3


def _first_instance(messages: Messages, name: str, assumed: list[str]) -> Messages:
    """The messages of the first of several receivers or mounts."""
    instance = messages.get("I")
    if instance is None or len(np.unique(instance)) < 2:
        return messages
    assumed.append(
        f"of {len(np.unique(instance))} instances of {name} in the log, number {instance.min():.0f}"
    )
    return Messages({key: column[instance == instance.min()] for key, column in messages.columns.items()})


def _aircraft(kinds: dict[str, Messages]) -> Attitudes | None:
    for name in ("ATT", "AHR2"):
        messages = kinds.get(name)
        if messages is not None and {"Yaw", "Pitch", "Roll"} <= messages.columns.keys():
            if messages.get("TimeUS", "TimeMS") is None:
                continue
            degrees = np.stack([messages.columns[axis] for axis in ("Yaw", "Pitch", "Roll")], axis=1)
            return Attitudes(_times_s(messages), np.radians(degrees))
    return None


def _gimbal(
    kinds: dict[str, Messages], aircraft: Attitudes | None, gap_s: float, assumed: list[str]
) -> Attitudes | None:
    """Angles of MNT: roll and pitch from the horizon; yaw from north (YawE), or from the nose (YawB)."""
    if "MNT" not in kinds or kinds["MNT"].get("TimeUS") is None:
        return None
    mount = _first_instance(kinds["MNT"], "MNT", assumed)
    times_s = _times_s(mount)
    pitch, roll = mount.get("Pitch"), mount.get("Roll")
    if pitch is None:
        return None
    north = mount.get("YawE")
    yaw = np.full(len(times_s), math.nan) if north is None else np.radians(north)
    nose = mount.get("YawB")
    if nose is not None:
        yaw = np.where(np.isfinite(yaw), yaw, heading_at(times_s, aircraft, gap_s) + np.radians(nose))
    sideways = np.zeros(len(times_s)) if roll is None else np.radians(np.nan_to_num(roll))
    return Attitudes(times_s, np.stack([yaw, np.radians(pitch), sideways], axis=1))


@dataclass(frozen=True, slots=True)
class _Accuracy:
    horizontal_m: FloatArray
    vertical_m: FloatArray
    vdop: FloatArray


def _fixes(gps: Messages, gpa: Messages | None) -> Fixes | None:
    kind = gps.get("Status")
    if kind is None:
        return None
    times_s = _times_s(gps)
    unknown = np.full(len(times_s), math.nan)
    hdop = gps.get("HDop")
    accuracy = _accuracy(times_s, gpa, unknown)
    return Fixes(
        times_s,
        kind,
        accuracy.horizontal_m,
        accuracy.vertical_m,
        unknown if hdop is None else hdop,
        accuracy.vdop,
    )


def _accuracy(times_s: FloatArray, gpa: Messages | None, unknown: FloatArray) -> _Accuracy:
    """What GPA says at or before each GPS message."""
    if gpa is None or gpa.get("TimeUS", "TimeMS") is None:
        return _Accuracy(unknown, unknown, unknown)
    gpa = _first_instance(gpa, "GPA", [])
    own_s = _times_s(gpa)
    nearest = np.clip(np.searchsorted(own_s, times_s), 0, len(own_s) - 1)

    def at(name: str) -> FloatArray:
        column = gpa.get(name)
        return unknown if column is None else column[nearest]

    return _Accuracy(at("HAcc"), at("VAcc"), at("VDop"))


def _utc_offset_s(gps: Messages) -> float | None:
    week, milliseconds = gps.get("GWk", "Week"), gps.get("GMS", "TimeMS")
    if week is None or milliseconds is None:
        return None
    utc_s = _GPS_EPOCH_S + week * _WEEK_S + milliseconds * 1e-3 - _LEAP_S
    return times_of_utc(_times_s(gps), np.where(week > 0.0, utc_s, math.nan))

"""PX4's logs (``.ulg``). Position and fix: the receiver's topic, else the estimate ``vehicle_global_position``.

Attitude: ``vehicle_attitude``. Gimbal: ``gimbal_device_attitude_status``, else ``mount_orientation``, which is
what the gimbal was told. Times count since boot; the receiver gives the date. Heights are above sea level.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.attitude import Attitudes, angles_of_quaternions, camera_on_aircraft
from pipeline.ingest.flight_log import Fixes, FlightLog, times_of_utc, track_of_log
from pipeline.ingest.samples import LeftOut
from pipeline.ingest.telemetry.binary_file import read_bytes
from pipeline.ingest.telemetry.mavlink_gimbal import device_attitudes
from pipeline.ingest.track import Track
from pipeline.messages import FloatArray

EXPECTED = "a PX4 log (.ulg) with positions"
MAGIC = b"ULog\x01\x12\x35"
_RECEIVERS, _ESTIMATE = ("vehicle_gps_position", "sensor_gps"), "vehicle_global_position"
_ATTITUDE, _DEVICE, _MOUNT = "vehicle_attitude", "gimbal_device_attitude_status", "mount_orientation"
_TOPICS = (*_RECEIVERS, _ESTIMATE, _ATTITUDE, _DEVICE, _MOUNT)
#: names of a field, older ones last, and what they are counted in
_FIELDS = {
    "latitude": (("latitude_deg", 1.0), ("lat", 1.0)),
    "longitude": (("longitude_deg", 1.0), ("lon", 1.0)),
    "absolute_height": (("altitude_msl_m", 1.0), ("alt", 1.0)),
}
Topic = Mapping[str, FloatArray]


def is_px4_ulog(path: Path, head: bytes) -> bool:
    """Whether a file is a ULog."""
    return head.startswith(MAGIC)


def read_px4_ulog(telemetry: Telemetry) -> Track:
    """The samples of a log. Raises InputError if none can be used."""
    path, left_out, assumed = telemetry.file, LeftOut(), list[str]()
    topics = _topics(path, left_out)
    name = next((n for n in (*_RECEIVERS, _ESTIMATE) if _has_positions(topics.get(n))), None)
    if name is None:
        raise InputError(
            path, "no topic with positions", f"{EXPECTED}: {', '.join((*_RECEIVERS, _ESTIMATE))}"
        )
    source, gap_s = topics[name], telemetry.longest_gap
    times_s = source["timestamp"] * 1e-6
    aircraft = None
    if _ATTITUDE in topics and "q[0]" in topics[_ATTITUDE]:
        own = topics[_ATTITUDE]
        aircraft = Attitudes(own["timestamp"] * 1e-6, angles_of_quaternions(_quaternions(own)))
    receiver = None if name == _ESTIMATE else source
    log = FlightLog(
        times_s,
        _positions(source),
        height_datum="geoid",
        aircraft=aircraft,
        gimbal=_gimbal(topics, aircraft, gap_s, assumed),
        fixes=_fixes(source, times_s),
        utc_offset_s=None
        if receiver is None or "time_utc_usec" not in receiver
        else times_of_utc(times_s, receiver["time_utc_usec"] * 1e-6),
        left_out=left_out,
        assumed=assumed,
    )
    return track_of_log(path, log, EXPECTED, gap_s)


def _topics(path: Path, left_out: LeftOut) -> dict[str, Topic]:
    """The first instance of each wanted topic, as float64 columns."""
    from pyulog import ULog

    data = read_bytes(path, EXPECTED)
    if not data.startswith(MAGIC):
        raise InputError(path, "a file that is no ULog", EXPECTED)
    try:
        with redirect_stdout(StringIO()):  # it prints what it meets; damage is counted instead
            log = ULog(str(path), list(_TOPICS), disable_str_exceptions=True)
    except Exception as error:  # pyulog raises whatever its parsing meets in a damaged head
        raise InputError(path, f"a damaged log ({type(error).__name__})", EXPECTED) from None
    if log.file_corruption:
        left_out.add("damaged", str(path))
    topics: dict[str, Topic] = {}
    for dataset in sorted(log.data_list, key=lambda d: d.multi_id):
        columns = _numeric(dataset.data)
        if "timestamp" in columns and dataset.name not in topics:
            topics[dataset.name] = columns
    return topics


def _numeric(data: Mapping[str, Any]) -> Topic:
    """Columns as float64; integers of degrees are 1e-7 degrees, of metres millimetres."""
    columns = {}
    for name, values in data.items():
        array = np.asarray(values)
        if array.dtype.kind not in "iufb" or array.ndim != 1:
            continue
        factor = 1.0
        if array.dtype.kind == "i" and name in ("lat", "lon"):
            factor = 1e-7
        elif array.dtype.kind == "i" and name in ("alt", "alt_ellipsoid"):
            factor = 1e-3
        columns[name] = array.astype(np.float64) * factor
    return columns


def _has_positions(topic: Topic | None) -> bool:
    return (
        topic is not None
        and len(topic["timestamp"]) > 0
        and {"latitude", "longitude"} <= _positions(topic).keys()
    )


def _positions(topic: Topic) -> dict[str, FloatArray]:
    found = {}
    for field, names in _FIELDS.items():
        known = next(((topic[name], factor) for name, factor in names if name in topic), None)
        if known is not None:
            found[field] = known[0] * known[1]
    return found


def _quaternions(topic: Topic) -> FloatArray:
    return np.stack([topic[f"q[{k}]"] for k in range(4)], axis=1)


def _fixes(topic: Topic, times_s: FloatArray) -> Fixes:
    """eph and epv are standard deviations of the receiver, or of the estimate, metres."""
    unknown = np.full(len(times_s), math.nan)
    return Fixes(
        times_s,
        topic.get("fix_type", unknown),
        topic.get("eph", unknown),
        topic.get("epv", unknown),
        topic.get("hdop", unknown),
        topic.get("vdop", unknown),
    )


def _gimbal(
    topics: Mapping[str, Topic], aircraft: Attitudes | None, gap_s: float, assumed: list[str]
) -> Attitudes | None:
    device = topics.get(_DEVICE)
    if device is not None and {"q[0]", "q[1]", "q[2]", "q[3]"} <= device.keys():
        times_s = device["timestamp"] * 1e-6
        flags = device.get("device_flags", np.zeros(len(times_s)))
        return device_attitudes(times_s, flags, _quaternions(device), aircraft, gap_s)
    mount = topics.get(_MOUNT)
    if mount is None or aircraft is None or "attitude_euler_angle[2]" not in mount:
        return None
    assumed.append("mount_orientation: the angles that the gimbal was told, from the aircraft")
    times_s = mount["timestamp"] * 1e-6
    relative = np.stack([mount[f"attitude_euler_angle[{k}]"] for k in (2, 1, 0)], axis=1)
    return Attitudes(times_s, camera_on_aircraft(aircraft.at(times_s, gap_s), relative))

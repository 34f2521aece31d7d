"""MAVLink telemetry logs (``.tlog``), as Mission Planner, QGroundControl and MAVProxy write them.

Position, heights and attitude are the autopilot's estimates; the fix is the receiver's. Times are the autopilot's
own (since boot), laid on the ground station's, so that the radio's delays do not count.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.attitude import Attitudes
from pipeline.ingest.flight_log import Fixes, FlightLog, columns_of, times_of_utc, track_of_log
from pipeline.ingest.samples import LeftOut
from pipeline.ingest.telemetry.binary_file import read_bytes
from pipeline.ingest.telemetry.mavlink_frames import LoggedMessage, is_frame_after_stamp, messages_of
from pipeline.ingest.telemetry.mavlink_gimbal import device_attitudes, heading_at
from pipeline.ingest.track import Track
from pipeline.messages import FloatArray

EXPECTED = "a MAVLink telemetry log (.tlog) with positions"
HEARTBEAT, SYSTEM_TIME, GPS_RAW, ATTITUDE, POSITION = 0, 2, 24, 30, 33
MOUNT_STATUS, CAMERA_FEEDBACK, CAPTURE_STATUS, MOUNT_ORIENTATION, GIMBAL_DEVICE = 158, 180, 262, 265, 285
WANTED = frozenset(
    (
        *(HEARTBEAT, SYSTEM_TIME, GPS_RAW, ATTITUDE, POSITION),
        *(MOUNT_STATUS, CAMERA_FEEDBACK, CAPTURE_STATUS, MOUNT_ORIENTATION, GIMBAL_DEVICE),
    )
)
#: heartbeats of ground stations (type) and of whatever is no autopilot
_GROUND_STATION, _NO_AUTOPILOT = 6, 8
#: the autopilot's clock may lag behind by the radio's delay; a step back by more is a new start
_NEW_START_MS = 5000.0
_UNKNOWN_DILUTION = 65535


def is_mavlink_tlog(path: Path, head: bytes) -> bool:
    """Whether a file begins with a time and a MAVLink frame."""
    return is_frame_after_stamp(head, 0) and (path.suffix.lower() == ".tlog" or _plausible_date(head))


def read_mavlink_tlog(telemetry: Telemetry) -> Track:
    """The samples of the vehicle. Raises InputError if there is none, or if there are several and none is named."""
    path, left_out = telemetry.file, LeftOut()
    data = read_bytes(path, EXPECTED)
    return track_of_messages(path, list(messages_of(data, WANTED, path, left_out)), telemetry, left_out)


def track_of_messages(
    path: Path, messages: Sequence[LoggedMessage], telemetry: Telemetry, left_out: LeftOut
) -> Track:
    """The samples of the vehicle in messages as they were received. Raises InputError as read_mavlink_tlog does."""
    if not messages:
        raise InputError(path, f"no message of an aircraft ({left_out or 'none at all'})", EXPECTED)
    vehicle = _vehicle(path, messages, telemetry)
    own = [m for m in messages if m.system == vehicle]
    by_id: dict[int, list[LoggedMessage]] = defaultdict(list)
    for message in own:
        by_id[message.id].append(message)
    assumed: list[str] = []
    clock = _Clock(own, messages[0].received_us, assumed)
    gap_s = telemetry.longest_gap
    rows = [
        (clock.s(m), m.fields.lat, m.fields.lon, m.fields.alt, m.fields.relative_alt) for m in by_id[POSITION]
    ]
    times_s, latitude, longitude, absolute_mm, relative_mm = columns_of(rows, 5)
    aircraft = Attitudes(*_angles(by_id[ATTITUDE], clock, lambda f: (f.yaw, f.pitch, f.roll)))
    log = FlightLog(
        times_s,
        {
            "latitude": latitude * 1e-7,
            "longitude": longitude * 1e-7,
            "absolute_height": absolute_mm * 1e-3,
            "relative_height": relative_mm * 1e-3,
        },
        height_datum="geoid",
        aircraft=aircraft,
        gimbal=_gimbal(by_id, clock, aircraft, gap_s, assumed),
        fixes=_fixes(by_id[GPS_RAW], clock),
        recording=_recording(by_id[CAPTURE_STATUS], clock),
        utc_offset_s=_utc_offset_s(by_id[SYSTEM_TIME], clock, messages[0].received_us, assumed),
        left_out=left_out,
        assumed=assumed,
    )
    return track_of_log(path, log, EXPECTED, gap_s)


class _Clock:
    """Seconds since the log's first message, of messages with a time since boot and of those without."""

    def __init__(self, own: Sequence[LoggedMessage], first_us: int, assumed: list[str]) -> None:
        self._first_us = first_us
        stamped = [(m.received_us, boot) for m in own if (boot := getattr(m.fields, "time_boot_ms", 0))]
        received_s, boot_ms = columns_of(stamped, 2)
        self._offset_s: float | None = None
        if stamped and np.all(np.diff(boot_ms) > -_NEW_START_MS):
            self._offset_s = float(np.median((received_s - first_us) * 1e-6 - boot_ms * 1e-3))
        elif stamped:
            assumed.append(
                "the autopilot was started again in this log: times are when messages were received"
            )

    def s(self, message: LoggedMessage) -> float:
        """Time of a message."""
        boot_ms = getattr(message.fields, "time_boot_ms", 0)
        if boot_ms and self._offset_s is not None:
            return float(boot_ms * 1e-3 + self._offset_s)
        return (message.received_us - self._first_us) * 1e-6


def _vehicle(path: Path, messages: Sequence[LoggedMessage], telemetry: Telemetry) -> int:
    """The system whose positions are taken: the only vehicle that has any, or the one that the mission names."""
    stations = {m.system for m in messages if m.id == HEARTBEAT and m.fields.type == _GROUND_STATION}
    count = Counter(m.system for m in messages if m.id == POSITION and (m.fields.lat or m.fields.lon))
    if not count:  # positions without a fix are still the vehicle's, to be left out and counted
        count = Counter(m.system for m in messages if m.id == POSITION)
    vehicles = sorted(set(count) - stations) or sorted(count)
    if telemetry.system_id is not None:
        if telemetry.system_id not in count:
            known = ", ".join(map(str, vehicles)) or "none"
            raise InputError(
                path, f"no position of system {telemetry.system_id}", f"telemetry.system_id: {known}"
            )
        return telemetry.system_id
    if not vehicles:
        raise InputError(path, "no GLOBAL_POSITION_INT message", EXPECTED)
    if len(vehicles) > 1:
        listed = ", ".join(f"{v} ({count[v]} positions)" for v in vehicles)
        raise InputError(
            path, f"several vehicles, systems {listed}", "telemetry.system_id: the one that films"
        )
    return vehicles[0]


def _angles(messages: Sequence[LoggedMessage], clock: _Clock, of: Any) -> tuple[FloatArray, FloatArray]:
    rows = [(clock.s(m), *of(m.fields)) for m in messages]
    table = np.array(rows, np.float64).reshape(-1, 4)
    return table[:, 0], table[:, 1:]


def _gimbal(
    by_id: dict[int, list[LoggedMessage]],
    clock: _Clock,
    aircraft: Attitudes,
    gap_s: float,
    assumed: list[str],
) -> Attitudes | None:
    """The camera's attitudes, of the first kind of message that has any: newer protocols first."""
    if device := _one_source(by_id[GIMBAL_DEVICE], assumed):
        times_s, flags, *quaternion = columns_of(
            [(clock.s(m), m.fields.flags, *m.fields.q) for m in device], 6
        )
        return device_attitudes(times_s, flags, np.stack(quaternion, axis=1), aircraft, gap_s)
    if orientation := _one_source(by_id[MOUNT_ORIENTATION], assumed):
        rows = [
            (clock.s(m), m.fields.roll, m.fields.pitch, m.fields.yaw, m.fields.yaw_absolute)
            for m in orientation
        ]
        times_s, roll, pitch, yaw, absolute = columns_of(rows, 5)
        if not np.nan_to_num(absolute).any() and np.nan_to_num(yaw).any():
            absolute = np.full(len(yaw), math.nan)  # an extension that this sender does not fill
        own = heading_at(times_s, aircraft, gap_s) + np.radians(yaw)
        north = np.where(np.isfinite(absolute), np.radians(absolute), own)
        return Attitudes(
            times_s, np.stack([north, np.radians(pitch), np.radians(np.nan_to_num(roll))], axis=1)
        )
    if status := _one_source(by_id[MOUNT_STATUS], assumed):
        pointing = [
            (clock.s(m), m.fields.pointing_a, m.fields.pointing_b, m.fields.pointing_c) for m in status
        ]
        times_s, pitch, roll, yaw = columns_of(pointing, 4)
        assumed.append("MOUNT_STATUS: pitch and roll from the horizon, yaw from the aircraft's nose")
        north = heading_at(times_s, aircraft, gap_s) + np.radians(yaw / 100.0)
        return Attitudes(
            times_s, np.stack([north, np.radians(pitch / 100.0), np.radians(roll / 100.0)], axis=1)
        )
    if feedback := by_id[CAMERA_FEEDBACK]:
        assumed.append("the camera's angles are those of CAMERA_FEEDBACK, one for each picture it took")
        times_s, degrees = _angles(feedback, clock, lambda f: (f.yaw, f.pitch, f.roll))
        return Attitudes(times_s, np.radians(degrees))
    return None


def _one_source(messages: list[LoggedMessage], assumed: list[str]) -> list[LoggedMessage]:
    """The messages of one gimbal, the one that sends most, where there are several."""
    senders = Counter((m.component, getattr(m.fields, "gimbal_device_id", 0)) for m in messages)
    if len(senders) < 2:
        return messages
    chosen = max(senders, key=lambda sender: senders[sender])
    assumed.append(
        f"of {len(senders)} gimbals in the log, the one of component {chosen[0]}, device {chosen[1]}"
    )
    return [m for m in messages if (m.component, getattr(m.fields, "gimbal_device_id", 0)) == chosen]


def _fixes(messages: Sequence[LoggedMessage], clock: _Clock) -> Fixes | None:
    if not messages:
        return None
    rows = []
    for m in messages:
        f = m.fields
        hdop, vdop = (math.nan if v == _UNKNOWN_DILUTION else v / 100.0 for v in (f.eph, f.epv))
        rows.append((clock.s(m), f.fix_type, f.h_acc / 1000.0, f.v_acc / 1000.0, hdop, vdop))
    return Fixes(*columns_of(rows, 6))


def _recording(messages: Sequence[LoggedMessage], clock: _Clock) -> tuple[FloatArray, FloatArray] | None:
    if not messages:
        return None
    times_s, on = columns_of([(clock.s(m), float(m.fields.video_status == 1)) for m in messages], 2)
    return times_s, on


def _utc_offset_s(
    messages: Sequence[LoggedMessage], clock: _Clock, first_us: int, assumed: list[str]
) -> float:
    times_s, utc_s = columns_of([(clock.s(m), m.fields.time_unix_usec * 1e-6) for m in messages], 2)
    offset_s = times_of_utc(times_s, utc_s)
    if offset_s is not None:
        return offset_s
    assumed.append("dates are those of the ground station's clock: the vehicle sent none (SYSTEM_TIME)")
    return first_us * 1e-6


def _plausible_date(head: bytes) -> bool:
    """Whether the first 8 bytes are microseconds of a date between 1990 and 2100."""
    return 631_152_000_000_000 < int.from_bytes(head[:8], "big") < 4_102_444_800_000_000

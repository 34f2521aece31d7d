"""A track as a MAVLink telemetry log; pymavlink packs the messages, the log's frame is written here."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as m

from pipeline.ingest.track import Track
from tests.dialects.attitudes import aircraft_of, quaternion

BOOT_MS = 60_000


class Log:
    """Messages of one or more systems in a log."""

    def __init__(self, start_us: int) -> None:
        self.data, self._start_us = bytearray(), start_us
        self._senders: dict[tuple[int, int], m.MAVLink] = {}

    def add(
        self, time_s: float, message: Any, system: int = 1, component: int = 1, delay_s: float = 0.0
    ) -> None:
        sender = self._senders.setdefault((system, component), m.MAVLink(None, system, component))
        packed = message.pack(sender)
        sender.seq = (sender.seq + 1) % 256
        stamp_us = self._start_us + round((time_s + delay_s) * 1e6)
        self.data += stamp_us.to_bytes(8, "big") + packed


def heartbeat(kind: int = m.MAV_TYPE_QUADROTOR, autopilot: int = m.MAV_AUTOPILOT_ARDUPILOTMEGA) -> Any:
    return m.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3)


def position(rows: Track, i: int, boot_ms: int) -> Any:
    return m.MAVLink_global_position_int_message(
        boot_ms, round(rows.latitude_deg[i] * 1e7), round(rows.longitude_deg[i] * 1e7),
        round(rows.absolute_height_m[i] * 1e3), round(rows.relative_height_m[i] * 1e3), 0, 0, 0, 0,
    )  # fmt: skip


def fix(boot_ms: int, kind: int = 3, h_acc_mm: int = 900, hdop: int = 80) -> Any:
    return m.MAVLink_gps_raw_int_message(
        boot_ms * 1000, kind, 0, 0, 0, hdop, 150, 0, 0, 12, 0, h_acc_mm, 1400, 0, 0
    )


def gimbal_message(kind: str, rows: Track, i: int, boot_ms: int) -> Any:
    """kind: device (yaw from the vehicle), device-north, orientation or status."""
    yaw, pitch, roll = (float(v[i]) for v in (rows.yaw_rad, rows.pitch_rad, rows.roll_rad))
    relative = yaw - aircraft_of(yaw)[0]
    if kind.startswith("device"):
        flags = 64 if kind == "device-north" else 32
        q = quaternion(yaw if flags == 64 else relative, pitch, roll)
        return m.MAVLink_gimbal_device_attitude_status_message(0, 0, boot_ms, 12 | flags, list(q), 0, 0, 0, 0)
    degrees = [math.degrees(v) for v in (roll, pitch, relative, yaw)]
    if kind == "orientation":
        return m.MAVLink_mount_orientation_message(boot_ms, *degrees)
    return m.MAVLink_mount_status_message(
        0, 0, round(degrees[1] * 100), round(degrees[0] * 100), round(degrees[2] * 100)
    )


def log_of(rows: Track, gimbal: str | None = "device", recording: tuple[float, float] | None = None) -> Log:
    """Every row: position, attitude and gimbal; the fix and the heartbeat once a second, 40 ms late by radio."""
    log = Log(rows.start_time_ns // 1000)
    told = -1
    for i, time_s in enumerate((rows.times_s - rows.times_s[0]).tolist()):
        boot_ms = BOOT_MS + round(time_s * 1000)
        late_s = 0.04 * (i % 3)
        if int(time_s) > told:
            told = int(time_s)
            log.add(time_s, heartbeat())
            log.add(time_s, heartbeat(m.MAV_TYPE_GCS, m.MAV_AUTOPILOT_INVALID), 255, 190)
            log.add(time_s, fix(boot_ms))
            log.add(
                time_s,
                m.MAVLink_system_time_message((rows.start_time_ns // 1000) + round(time_s * 1e6), boot_ms),
            )
            log.add(time_s, m.MAVLink_sys_status_message(0, 0, 0, 0, 12000, 0, 80, 0, 0, 0, 0, 0, 0))
        yaw, pitch, roll = aircraft_of(float(rows.yaw_rad[i]))
        log.add(
            time_s,
            m.MAVLink_attitude_message(boot_ms, roll, pitch, math.remainder(yaw, 2 * math.pi), 0, 0, 0),
            delay_s=late_s,
        )
        log.add(time_s, position(rows, i, boot_ms), delay_s=late_s)
        if gimbal is not None:
            log.add(
                time_s,
                gimbal_message(gimbal, rows, i, boot_ms),
                component=154,
                delay_s=0.0 if gimbal == "status" else late_s,
            )
        if recording is not None:
            on = int(recording[0] <= time_s < recording[1])
            log.add(time_s, m.MAVLink_camera_capture_status_message(boot_ms, 0, on, 0, 0, 0), component=100)
    return log


def write(
    path: Path, rows: Track, gimbal: str | None = "device", recording: tuple[float, float] | None = None
) -> None:
    path.write_bytes(bytes(log_of(rows, gimbal, recording).data))

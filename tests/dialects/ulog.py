"""A track as a PX4 log (ULog), written from its description."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from pathlib import Path

from pipeline.ingest.track import Track
from tests.dialects.attitudes import aircraft_of, quaternion

MAGIC = b"ULog\x01\x12\x35\x01"
TYPES = {
    "uint64_t": "Q",
    "int32_t": "i",
    "float": "f",
    "double": "d",
    "uint8_t": "B",
    "uint32_t": "I",
    "uint16_t": "H",
}
OLD_GPS = (
    "vehicle_gps_position:uint64_t timestamp;uint64_t time_utc_usec;int32_t lat;int32_t lon;int32_t alt;"
    "float eph;float epv;float hdop;float vdop;uint8_t fix_type;uint8_t satellites_used;"
)
NEW_GPS = (
    "sensor_gps:uint64_t timestamp;uint64_t time_utc_usec;double latitude_deg;double longitude_deg;"
    "double altitude_msl_m;float eph;float epv;float hdop;float vdop;uint8_t fix_type;uint8_t satellites_used;"
)
ESTIMATE = "vehicle_global_position:uint64_t timestamp;double lat;double lon;float alt;float eph;float epv;"
ATTITUDE = "vehicle_attitude:uint64_t timestamp;float[4] q;"
DEVICE = "gimbal_device_attitude_status:uint64_t timestamp;float[4] q;uint16_t device_flags;"
MOUNT = "mount_orientation:uint64_t timestamp;float[3] attitude_euler_angle;"
OTHER = "cpuload:uint64_t timestamp;float load;"
BOOT_US = 12_000_000


class Log:
    """Messages behind a head that describes them."""

    def __init__(self, formats: Sequence[str]) -> None:
        self.data = bytearray(MAGIC + struct.pack("<Q", BOOT_US))
        self._add(b"B", bytes(40))
        self._ids, self._codes = {}, {}
        for text in formats:
            self._add(b"F", text.encode())
            name, fields = text.split(":")
            codes = "<"
            for field in fields.strip(";").split(";"):
                kind = field.split(" ")[0]
                count = int(kind[kind.index("[") + 1 : -1]) if "[" in kind else 1
                codes += TYPES[kind.split("[")[0]] * count
            self._codes[name] = codes
        for number, name in enumerate(self._codes):
            self._ids[name] = number
            self._add(b"A", struct.pack("<BH", 0, number) + name.encode())

    def _add(self, kind: bytes, body: bytes) -> None:
        self.data += struct.pack("<H", len(body)) + kind + body

    def add(self, name: str, *values: float) -> None:
        self._add(b"D", struct.pack("<H", self._ids[name]) + struct.pack(self._codes[name], *values))


def gps(log: Log, rows: Track, i: int, time_us: int, kind: int = 3, new: bool = False) -> None:
    utc_us = rows.start_time_ns // 1000 + round((rows.times_s[i] - rows.times_s[0]) * 1e6)
    lat, lon, alt = rows.latitude_deg[i], rows.longitude_deg[i], rows.absolute_height_m[i]
    tail = (0.9, 1.4, 0.8, 1.5, kind, 14)
    if new:
        log.add("sensor_gps", time_us, utc_us, lat, lon, alt, *tail)
    else:
        log.add(
            "vehicle_gps_position",
            time_us,
            utc_us,
            round(lat * 1e7),
            round(lon * 1e7),
            round(alt * 1e3),
            *tail,
        )


def write(path: Path, rows: Track, *, source: str = "old", gimbal: str | None = "device") -> None:
    """Every row. source: old, new or estimate. gimbal: device (yaw from the vehicle), mount or None."""
    formats = [{"old": OLD_GPS, "new": NEW_GPS, "estimate": ESTIMATE}[source], ATTITUDE, OTHER]
    formats += [] if gimbal is None else [DEVICE if gimbal == "device" else MOUNT]
    log = Log(formats)
    for i, time_s in enumerate((rows.times_s - rows.times_s[0]).tolist()):
        time_us = BOOT_US + round(time_s * 1e6)
        camera = tuple(float(v[i]) for v in (rows.yaw_rad, rows.pitch_rad, rows.roll_rad))
        aircraft = aircraft_of(camera[0])
        log.add("vehicle_attitude", time_us, *quaternion(*aircraft))
        if source == "estimate":
            alt = rows.absolute_height_m[i]
            log.add(
                "vehicle_global_position", time_us, rows.latitude_deg[i], rows.longitude_deg[i], alt, 0.9, 1.4
            )
        else:
            gps(log, rows, i, time_us, new=source == "new")
        if gimbal == "device":
            log.add(
                "gimbal_device_attitude_status",
                time_us,
                *quaternion(camera[0] - aircraft[0], *camera[1:]),
                12 | 32,
            )
        elif gimbal == "mount":
            from tests.dialects.attitudes import relative_angles

            yaw, pitch, roll = relative_angles(camera, aircraft)
            log.add("mount_orientation", time_us, roll, pitch, math.remainder(yaw, 2 * math.pi))
        log.add("cpuload", time_us, 0.5)
    path.write_bytes(bytes(log.data))

"""A track as an ArduPilot dataflash log."""

from __future__ import annotations

import math
import struct
from pathlib import Path

from pipeline.ingest.track import Track
from tests.dialects.attitudes import aircraft_of

CODES = {
    "B": "B",
    "Q": "Q",
    "I": "I",
    "H": "H",
    "c": "h",
    "C": "H",
    "e": "i",
    "E": "I",
    "L": "i",
    "f": "f",
    "b": "b",
}
#: name -> number, layout, fields
KINDS = {
    "GPS": (130, "QBBIHBcLLef", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd"),
    "GPA": (131, "QBCCCC", "TimeUS,I,VDop,HAcc,VAcc,SAcc"),
    "ATT": (132, "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "POS": (133, "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "MNT": (134, "QBffffffff", "TimeUS,I,DesRoll,Roll,DesPitch,Pitch,DesYawB,YawB,DesYawE,YawE"),
    "AHR2": (135, "QcccfLL", "TimeUS,Roll,Pitch,Yaw,Alt,Lat,Lng"),
    "OLD": (137, "BIHBcLLeeEI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,T"),
    "BAT": (136, "Qf", "TimeUS,Volt"),
}
BOOT_US = 30_000_000
GPS_EPOCH_S, LEAP_S = 315_964_800, 18


def describe(number: int, name: str, layout: str, fields: str, length: int | None = None) -> bytes:
    size = 3 + struct.calcsize("<" + "".join(CODES[c] for c in layout)) if length is None else length
    return b"\xa3\x95\x80" + struct.pack(
        "<BB4s16s64s", number, size, name.encode(), layout.encode(), fields.encode()
    )


def head(*names: str) -> bytes:
    own = describe(0x80, "FMT", "", "Type,Length,Name,Format,Columns", 89)
    return own + b"".join(describe(KINDS[n][0], n, *KINDS[n][1:]) for n in names)


def message(name: str, *values: float) -> bytes:
    number, layout, _ = KINDS[name]
    return b"\xa3\x95" + bytes([number]) + struct.pack("<" + "".join(CODES[c] for c in layout), *values)


def gps(rows: Track, i: int, time_us: int, status: int = 3, instance: int = 0) -> bytes:
    gps_s = rows.start_time_ns * 1e-9 + (rows.times_s[i] - rows.times_s[0]) - GPS_EPOCH_S + LEAP_S
    week, ms = int(gps_s // 604800), round(gps_s % 604800 * 1000)
    return message(
        "GPS", time_us, instance, status, ms, week, 14, 85, round(rows.latitude_deg[i] * 1e7),
        round(rows.longitude_deg[i] * 1e7), round(rows.absolute_height_m[i] * 100), 3.0,
    )  # fmt: skip


def write(path: Path, rows: Track, *, source: str = "POS", gimbal: bool = True) -> None:
    """Every row. source: POS (beside GPS), GPS or AHR2."""
    names = {"POS": ["GPS", "GPA", "POS"], "GPS": ["GPS", "GPA"], "AHR2": ["AHR2"]}[source]
    data = bytearray(head(*names, "ATT", "BAT", *(["MNT"] if gimbal else [])))
    for i, time_s in enumerate((rows.times_s - rows.times_s[0]).tolist()):
        time_us = BOOT_US + round(time_s * 1e6)
        yaw, pitch, roll = (math.degrees(v) for v in aircraft_of(float(rows.yaw_rad[i])))
        lat, lng = round(rows.latitude_deg[i] * 1e7), round(rows.longitude_deg[i] * 1e7)
        data += message("ATT", time_us, 0, roll, 0, pitch, 0, yaw % 360.0)
        if source in ("POS", "GPS"):
            data += gps(rows, i, time_us) + message("GPA", time_us, 0, 150, 90, 140, 30)
        if source == "POS":
            data += message(
                "POS", time_us, lat, lng, rows.absolute_height_m[i], rows.relative_height_m[i], 0.0
            )
        if source == "AHR2":
            turned = math.remainder(yaw, 360.0)
            data += message(
                "AHR2", time_us, round(roll * 100), round(pitch * 100), round(turned * 100),
                rows.absolute_height_m[i], lat, lng,
            )  # fmt: skip
        if gimbal:
            own = [math.degrees(v[i]) for v in (rows.roll_rad, rows.pitch_rad, rows.yaw_rad)]
            data += message("MNT", time_us, 0, 0, own[0], 0, own[1], 0, own[2] - yaw, 0, own[2])
        data += message("BAT", time_us, 15.2)
    path.write_bytes(bytes(data))

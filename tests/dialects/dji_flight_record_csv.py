"""A track as a decoded DJI flight record: of Flight Reader, of TXTlogToCSVtool, or of dji-log-parser."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path

from pipeline.ingest.track import Track

HEADS = {
    "flight-reader": "CUSTOM.date [{zone}],CUSTOM.updateTime [{zone}],OSD.flyTime,OSD.flyTime [s],OSD.latitude,"
    "OSD.longitude,OSD.height [ft],OSD.heightMax [ft],OSD.altitude [ft],OSD.hSpeed [MPH],OSD.pitch,OSD.roll,OSD.yaw,"
    "OSD.yaw [360],OSD.flycState,OSD.gpsNum,OSD.gpsLevel,GIMBAL.pitch,GIMBAL.roll,GIMBAL.yaw,GIMBAL.yaw [360],"
    "CAMERA.isPhoto,CAMERA.isVideo,APP.tip",
    "txtlogtocsv": "CUSTOM.updateTime,CUSTOM.isPhoto,CUSTOM.isVideo,OSD.flyTime [s],OSD.latitude,OSD.longitude,"
    "OSD.height [m],OSD.altitude [m],OSD.xSpeed [m/s],OSD.pitch,OSD.roll,OSD.yaw,OSD.gpsNum,"
    "GIMBAL.pitch,GIMBAL.roll,"
    "GIMBAL.yaw,APP_TIP.tip",
    "dji-log-parser": "CUSTOM.dateTime,OSD.flyTime,OSD.latitude,OSD.longitude,OSD.height,OSD.altitude,OSD.pitch,"
    "OSD.roll,OSD.yaw,OSD.gpsNum,OSD.gpsLevel,OSD.droneType,GIMBAL.pitch,GIMBAL.roll,GIMBAL.yaw,CAMERA.isPhoto,CAMERA.isVideo",
}


def write(path: Path, rows: Track, tool: str = "flight-reader", zone: str = "UTC") -> None:
    """Every row of the track, all recording, as a tool writes it."""
    lines = ["sep=,"] if tool == "flight-reader" else []
    lines.append(HEADS[tool].format(zone=zone))
    for i, time_s in enumerate(rows.times_s - rows.times_s[0]):
        lines.append(_line(rows, i, float(time_s), tool))
    path.write_bytes(
        ("\r\n".join(lines) + "\r\n").encode("latin-1" if tool == "txtlogtocsv" else "utf-8-sig")
    )


def _line(rows: Track, i: int, time_s: float, tool: str) -> str:
    utc = datetime.fromtimestamp((rows.start_time_ns + round(time_s * 1e9)) / 1e9, UTC)
    yaw, pitch, roll = (round(math.degrees(v[i]), 1) for v in (rows.yaw_rad, rows.pitch_rad, rows.roll_rad))
    yaw = math.remainder(yaw, 360.0)
    at = f"{rows.latitude_deg[i]:.9f},{rows.longitude_deg[i]:.9f}"
    rel, abs_ = rows.relative_height_m[i], rows.absolute_height_m[i]
    if tool == "flight-reader":
        hour = f"{int(f'{utc:%I}')}:{utc:%M:%S}.{utc.microsecond // 10000:02d} {utc:%p}"
        return (
            f"{utc.month}/{utc.day}/{utc.year},{hour},0m {time_s:.1f}s,{time_s:.1f},{at},{rel / 0.3048:.1f},99.9,"
            f"{abs_ / 0.3048:.1f},3.2,-1.2,0.5,{yaw},{yaw % 360:.1f},P-GPS,17,5,{pitch},{roll},{yaw},{yaw % 360:.1f},"
            f'False,True,"Take care, wind"'
        )
    if tool == "txtlogtocsv":
        date = f"{utc:%Y/%m/%d %H:%M:%S}.{utc.microsecond // 1000:03d}"
        return (
            f"{date},,Recording,{time_s:.1f},{at},{rel:.1f},{abs_:.1f},1.0,-1.2,0.5,{yaw},17,"
            f"{pitch},{roll},{yaw},höjd"
        )
    return (
        f"{utc:%Y-%m-%dT%H:%M:%S}.{utc.microsecond // 1000:03d}Z,{time_s:.1f},{at},{rel:.1f},{abs_:.1f},-1.2,"
        f"0.5,{yaw},17,5,"
        f"Mavic3E,{pitch},{roll},{yaw},false,true"
    )

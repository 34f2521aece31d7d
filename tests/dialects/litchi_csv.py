"""A track as the app Litchi writes it: altitude above take-off, raw angles in tenths of a degree."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path

from pipeline.ingest.track import Track

HEAD = (
    "latitude,longitude,altitude({unit}),ultrasonicHeight({unit}),speed({speed}),distance({unit}),time(millisecond),"
    "datetime(utc),datetime(local),satellites,pressure(Pa),voltage(v),home_latitude,home_longitude,velocityX({speed}),"
    "pitch(deg),roll(deg),yaw(deg),powerlevel,isflying,istakingphoto,flightmode,isMotorsOn,isTakingVideo,Dronetype,"
    "pitchRaw,rollRaw,yawRaw,gimbalPitchRaw,gimbalRollRaw,gimbalYawRaw,flyState"
)


def write(path: Path, rows: Track, unit: str = "m", first_ms: int = 250) -> None:
    """Every row of the track; dates with milliseconds, UTC and two hours later for the local ones."""
    metres = 0.3048 if unit == "feet" else 1.0
    lines = [HEAD.format(unit=unit, speed="mph" if unit == "feet" else "mps")]
    for i, time_s in enumerate(rows.times_s - rows.times_s[0]):
        utc = datetime.fromtimestamp((rows.start_time_ns + round(time_s * 1e9)) / 1e9, UTC)
        yaw, pitch, roll = (
            round(math.degrees(v[i]) * 10) for v in (rows.yaw_rad, rows.pitch_rad, rows.roll_rad)
        )
        date = f"{utc:%Y-%m-%d %H:%M:%S}.{utc.microsecond // 1000:03d}"
        lines.append(
            f"{rows.latitude_deg[i]:.7f},{rows.longitude_deg[i]:.7f},"
            f"{rows.relative_height_m[i] / metres:.1f},0,2.5,3.1,"
            f"{first_ms + round(time_s * 1000)},{date},{date},14,0,15.1,58.4,15.5,1.1,-2.0,"
            f"1.5,{yaw / 10},0,1,0,6,1,1,13,"
            f"-20,15,{yaw},{pitch},{roll},{yaw},6"
        )
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")

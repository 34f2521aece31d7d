"""A track as Airdata writes it: heights in the user's unit, whole seconds of UTC beside milliseconds of flight."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path

from pipeline.ingest.track import Track

#: metres per unit and decimals that Airdata writes
UNITS = {"feet": (0.3048, 1), "meters": (1.0, 1)}
HEAD = (
    "time(millisecond),datetime(utc),latitude,longitude,height_above_takeoff({unit}),"
    "height_above_ground_at_drone_location({unit}),ground_elevation_at_drone_location({unit}),"
    "altitude_above_seaLevel({unit}),height_sonar({unit}),speed({speed}),distance({unit}),mileage({unit}),satellites,"
    "gpslevel,voltage(v), xSpeed({speed}), compass_heading(degrees), pitch(degrees), roll(degrees),isPhoto,isVideo,"
    "gimbal_heading(degrees),gimbal_pitch(degrees),gimbal_roll(degrees),battery_percent,altitude({unit}),flycState,message"
)


def write(path: Path, rows: Track, unit: str = "feet", first_ms: int = 100) -> None:
    """Every row of the track; the time of flight of the first is first_ms."""
    metres, decimals = UNITS[unit]
    lines = [HEAD.format(unit=unit, speed="mph" if unit == "feet" else "m/s")]
    for i, time_s in enumerate(rows.times_s - rows.times_s[0]):
        utc = datetime.fromtimestamp((rows.start_time_ns + round(time_s * 1e9)) // 1_000_000_000, UTC)
        rel, sea = (round(v[i] / metres, decimals) for v in (rows.relative_height_m, rows.absolute_height_m))
        yaw, pitch, roll = (
            round(math.degrees(v[i]), 1) for v in (rows.yaw_rad, rows.pitch_rad, rows.roll_rad)
        )
        lines.append(
            f"{first_ms + round(time_s * 1000)},{utc:%Y-%m-%d %H:%M:%S},"
            f"{rows.latitude_deg[i]:.9f},{rows.longitude_deg[i]:.9f},"
            f"{rel},{rel},{sea - rel:.1f},{sea},0,7.5,3.2,9.9,17,5,15.2,1.0,{yaw % 360:.1f},-1.2,0.3,0,1,"
            f'{yaw % 360:.1f},{pitch},{roll},88,{rel},P-GPS,"Home Point, recorded."'
        )
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")

"""A track as a table that nobody foresaw: semicolons, decimal commas, feet, radians, a line of units."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pipeline.ingest.track import Track

#: what a mission has to say of it
COLUMNS: dict[str, Any] = {
    "time": {"name": "Zeit (UTC)", "unit": "%d.%m.%Y %H:%M:%S,%f"},
    "latitude": {"name": "Breite"},
    "longitude": {"name": "Länge"},
    "absolute_height": {"name": "Höhe", "unit": "feet"},
    "yaw": {"name": "Kurs", "unit": "radians"},
    "pitch": {"name": "Nick", "unit": "radians"},
    "roll": {"name": "Roll", "unit": "radians"},
}
HEAD = "Flug 17;;;;;;\nZeit (UTC);Breite;Länge;Höhe;Kurs;Nick;Roll"


def write(path: Path, rows: Track, encoding: str = "utf-8-sig") -> None:
    """Every row of the track."""
    lines = [HEAD]
    for i, time_s in enumerate(rows.times_s - rows.times_s[0]):
        utc = datetime.fromtimestamp((rows.start_time_ns + round(time_s * 1e9)) / 1e9, UTC)
        numbers = (
            f"{rows.latitude_deg[i]:.9f}",
            f"{rows.longitude_deg[i]:.9f}",
            f"{rows.absolute_height_m[i] / 0.3048:.3f}",
            *(f"{v[i]:.6f}" for v in (rows.yaw_rad, rows.pitch_rad, rows.roll_rad)),
        )
        lines.append(";".join([f"{utc:%d.%m.%Y %H:%M:%S,%f}", *(n.replace(".", ",") for n in numbers)]))
    path.write_bytes(("\n".join(lines) + "\n").encode(encoding))

"""Times for people: ISO 8601, with the zone where it is known and ``local time`` where it is not."""

from __future__ import annotations

from datetime import UTC, datetime

from pipeline.ingest.track import Clock


def iso_time(time_ns: int, clock: Clock = "utc") -> str:
    """``2026-05-01T10:00:00.123Z``; without the Z where the clock is not known to be UTC. Milliseconds are cut."""
    seconds, rest_ns = divmod(time_ns, 1_000_000_000)
    text = f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{rest_ns // 1_000_000:03d}"
    return text + "Z" if clock == "utc" else text


def clock_time(time_ns: int) -> str:
    """``10:00:00``, the time of day; fractions are cut."""
    return iso_time(time_ns)[11:19]


def zone_name(clock: Clock) -> str:
    """What to write beside a time."""
    return {"utc": "UTC", "local": "local time", "unknown": "time of the video"}[clock]

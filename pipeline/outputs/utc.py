"""Times for people: ISO 8601 in UTC."""

from __future__ import annotations

from datetime import UTC, datetime


def iso_utc(time_ns: int) -> str:
    """``2026-05-01T10:00:00.123Z``; milliseconds are cut, not rounded."""
    seconds, rest_ns = divmod(time_ns, 1_000_000_000)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{rest_ns // 1_000_000:03d}Z"


def clock_utc(time_ns: int) -> str:
    """``10:00:00``, the time of day; fractions are cut."""
    return iso_utc(time_ns)[11:19]

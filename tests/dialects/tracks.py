"""Flights that the writers of binary logs lay down."""

from __future__ import annotations

import numpy as np

from pipeline.ingest.track import Track

START_NS = 1_781_429_400_000_000_000  # 2026-06-14 09:30:00 UTC


def flight(rows: int = 60, rate_hz: float = 10.0) -> Track:
    """A flight that climbs and turns past north while its camera looks down more and more."""
    times_s = np.arange(rows) / rate_hz
    return Track(
        START_NS,
        times_s,
        58.4 + 1e-5 * times_s,
        15.57 - 2e-5 * times_s,
        120.0 + 0.5 * times_s,
        20.0 + 0.5 * times_s,
        np.radians(np.mod(350.0 + 5.0 * times_s + 180.0, 360.0) - 180.0),
        np.radians(-45.0 - times_s),
        np.radians(0.5 * np.ones(rows)),
    )

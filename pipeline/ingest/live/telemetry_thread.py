"""Telemetry that does not come with the pictures, read in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

from pipeline.config.telemetry import Telemetry
from pipeline.ingest.live.arrivals import Arrivals
from pipeline.ingest.live.growing_file import GrowingFile
from pipeline.ingest.live.mavlink_udp import MavlinkUdp
from pipeline.ingest.track import Track
from pipeline.logs import Log

_LOG = Log("ingest")
#: between two tracks of the newest samples, seconds
_TRACK_S = 0.2


class TelemetryInput(Protocol):
    """Where samples come from."""

    def track(self, wait_s: float) -> Track | None:
        """Hear what comes within a time, then the newest samples, dates UTC; None without any."""

    def close(self) -> None:
        """Hear no more."""


def telemetry_input(telemetry: Telemetry, arrivals: Arrivals) -> TelemetryInput:
    """Of a port or a file. Raises InputError if a port cannot be had."""
    if telemetry.heard is not None:
        return MavlinkUdp(telemetry.heard, telemetry, lambda: round(arrivals.utc_s() * 1e6))
    return GrowingFile(telemetry, arrivals.utc_s)


class TelemetryThread:
    """Begins when it is made. on_track: is given the newest samples, on the stream's clock."""

    def __init__(self, telemetry: Telemetry, arrivals: Arrivals, on_track: Callable[[Track], None]) -> None:
        self._telemetry, self._arrivals, self._on_track = telemetry, arrivals, on_track
        self._input = telemetry_input(telemetry, arrivals)
        self._stop = threading.Event()
        threading.Thread(target=self._run, name="live-telemetry", daemon=True).start()

    def stop(self) -> None:
        """Hear no more."""
        self._stop.set()

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                track = self._input.track(_TRACK_S)
                if track is not None:
                    self._on_track(self._on_the_streams_clock(track))
        except Exception as error:  # of what came: the pictures go on without poses, and are counted
            _LOG.warning("telemetry broke off", error=f"{type(error).__name__}: {error}")
        finally:
            self._input.close()

    def _on_the_streams_clock(self, track: Track) -> Track:
        first_s = self._arrivals.of_utc_s(track.start_time_ns * 1e-9) + (self._telemetry.time_offset or 0.0)
        shift_s = first_s - float(track.times_s[0])
        end_s = None if track.end_s is None else track.end_s + shift_s
        return replace(track, times_s=track.times_s + shift_s, end_s=end_s)

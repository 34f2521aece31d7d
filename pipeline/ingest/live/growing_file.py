"""Telemetry in a file that is still written: its newest samples as a track."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.live.capture_clock import CaptureClock, CaptureClockParams
from pipeline.ingest.registry import format_of, read_telemetry
from pipeline.ingest.track import Track

#: so much of a file's end is read again each time, and of its beginning: its head
_TAIL_BYTES, _HEAD_BYTES = 128 * 1024, 64 * 1024
#: formats whose samples part at an empty line; at a line's end, below a head; or at a frame
_PARTED = {"dji-srt": b"\n\n", "mavlink-tlog": b""}


class GrowingFile:
    """utc_s: now, seconds since 1970. Of a large file only the end is read again."""

    def __init__(self, telemetry: Telemetry, utc_s: Callable[[], float]) -> None:
        self._telemetry, self._utc_s = telemetry, utc_s
        self._path, self._size, self._format = telemetry.file, -1, ""
        self._clock = CaptureClock()

    def track(self, wait_s: float) -> Track | None:
        """Wait so long, then the newest samples, dates UTC; None where nothing new can be used.

        Its own dates count if they are UTC and near this machine's clock; else when the samples were written.
        """
        time.sleep(wait_s)
        size = self._path.stat().st_size if self._path.is_file() else -1
        if size <= 0 or size == self._size:
            return None
        try:
            track = self._newest(size)
        except InputError:  # perhaps half a line
            return None
        self._size = size
        return self._dated(track)

    def _newest(self, size: int) -> Track:
        self._format = self._format or format_of(self._telemetry).name
        if size <= _TAIL_BYTES:
            return read_telemetry(self._telemetry)
        with self._path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
            file.seek(size - _TAIL_BYTES)
            tail = file.read(_TAIL_BYTES)
        part = _PARTED.get(self._format)
        if part is None:
            tail = _head_of_table(head) + tail[tail.find(b"\n") + 1 :]
        elif part:
            tail = tail.replace(b"\r\n", b"\n")
            tail = tail[tail.find(part) + len(part) :]
        with TemporaryDirectory() as folder:
            path = Path(folder) / self._path.name
            path.write_bytes(tail)
            told = self._telemetry.model_copy(update={"file": path, "format": self._format})
            return read_telemetry(told)

    def _dated(self, track: Track) -> Track:
        now_s, newest_s = self._utc_s(), float(track.times_s[-1])
        own_s = track.start_time_ns * 1e-9 + newest_s - float(track.times_s[0])
        if track.clock == "utc" and abs(own_s - now_s) <= CaptureClockParams().most_off_s:
            return track
        self._clock.heard(newest_s, now_s)
        first_s = self._clock.taken_s(float(track.times_s[0]))
        return replace(track, start_time_ns=round(first_s * 1e9), clock="utc")

    def close(self) -> None:
        """Nothing is held."""


def _head_of_table(head: bytes) -> bytes:
    """The lines before the first one that holds more digits than letters."""
    lines = head.splitlines(keepends=True)
    for number, line in enumerate(lines):
        digits = sum(48 <= byte <= 57 for byte in line)
        letters = sum(65 <= (byte & 0xDF) <= 90 for byte in line)
        if digits > letters:
            return b"".join(lines[:number])
    return b""

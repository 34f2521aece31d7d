"""MAVLink telemetry that comes over UDP: its newest messages as a track."""

from __future__ import annotations

import socket
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from pipeline.config.stream_url import StreamUrl
from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.live.klv_window import WINDOW_S
from pipeline.ingest.samples import LeftOut
from pipeline.ingest.telemetry.mavlink_frames import LoggedMessage, frames_in, messages_of
from pipeline.ingest.telemetry.mavlink_tlog import WANTED, track_of_messages
from pipeline.ingest.track import Track

_MOST_BYTES = 1 << 16


class MavlinkUdp:
    """What a vehicle sends to a port of ours. utc_us: now, microseconds since 1970."""

    def __init__(self, url: StreamUrl, telemetry: Telemetry, utc_us: Callable[[], int]) -> None:
        """Raises InputError if the port cannot be had."""
        self._telemetry, self._where, self._utc_us = telemetry, Path(str(url)), utc_us
        self._messages: deque[LoggedMessage] = deque()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((url.host or "0.0.0.0", url.port or 0))
        except OSError as error:
            self._socket.close()
            found = f"a port that cannot be listened on ({error.strerror})"
            raise InputError(url, found, "an address of this machine and a free port") from None

    def track(self, wait_s: float) -> Track | None:
        """Hear what comes within a time, then the newest samples, dates UTC by this machine's clock; None without any
        that can be used.
        """
        self._socket.settimeout(wait_s)
        try:
            while True:
                self._take(self._socket.recv(_MOST_BYTES))
                self._socket.settimeout(1e-4)  # what is there already
        except (TimeoutError, BlockingIOError):
            pass
        while self._messages and self._messages[0].received_us < self._utc_us() - WINDOW_S * 1e6:
            self._messages.popleft()
        if not self._messages:
            return None
        try:
            track = track_of_messages(self._where, list(self._messages), self._telemetry, LeftOut())
        except InputError:
            return None
        # their times are laid on those of arrival
        first_us = self._messages[0].received_us
        return replace(
            track, start_time_ns=first_us * 1000 + round(float(track.times_s[0]) * 1e9), clock="utc"
        )

    def _take(self, data: bytes) -> None:
        stamp = self._utc_us().to_bytes(8, "big")
        stamped = b"".join(stamp + frame for frame in frames_in(data))
        self._messages.extend(messages_of(stamped, WANTED, self._where, LeftOut()))

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()

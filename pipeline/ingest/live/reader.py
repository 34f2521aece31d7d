"""Reads a live stream in a thread of its own, over as many connections as it takes."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import chain, repeat
from typing import Any, Protocol

from pipeline.config.live import Live
from pipeline.config.stream_url import StreamUrl
from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.live.arrivals import Arrivals
from pipeline.ingest.live.capture_clock import CaptureClock
from pipeline.ingest.live.connection import Connection, KlvBytes, Shown, connect
from pipeline.ingest.live.fault import LiveFaultError
from pipeline.ingest.live.health import Health
from pipeline.ingest.live.klv_window import KlvWindow
from pipeline.ingest.live.recorder import Recorder
from pipeline.ingest.telemetry.misb_azimuth import Reading as AzimuthReading
from pipeline.ingest.track import Track
from pipeline.logs import Log

_LOG = Log("ingest")
#: between two attempts, seconds: the first few, and then
_PAUSES_S, _LONGEST_PAUSE_S = (0.2, 0.5, 1.0, 2.0), 4.0
#: the first pictures of a connection wait so long for a word of when they were taken, seconds: what a server had kept
#: comes at once, and would else seem to be taken at once
_SETTLES_S = 0.5
#: between two tracks of the newest KLV, seconds: each costs some milliseconds
_TRACK_S = 0.2


@dataclass(frozen=True)
class Reading:
    """What a reader is told. name: of the stream. arrivals: its clock. klv: what the mission says of it; None: there is
    other telemetry. recorder: keeps what comes. on_track: is given the newest samples, on the stream's clock.
    """

    name: str
    url: StreamUrl
    live: Live
    arrivals: Arrivals
    klv: Telemetry | None = None
    recorder: Recorder | None = None
    on_track: Callable[[Track], None] = field(default=lambda track: None)


class Pictures(Protocol):
    """What is made of the pictures of a stream."""

    def restart(self, connection: Connection) -> None:
        """Those that follow are of another connection."""

    def take(self, shown: Shown, time_s: float, connection: Connection) -> None:
        """A picture as it came. time_s: when it was taken, on the stream's clock; NaN where nothing tells it."""

    def end(self) -> None:
        """Nothing more comes."""


class LiveReader:
    """Begins when it is made."""

    def __init__(self, told: Reading, pictures: Pictures) -> None:
        self._told, self._pictures = told, pictures
        self.clock = CaptureClock(believes=told.live.clock == "auto")
        self._window = KlvWindow(told.klv, str(told.url)) if told.klv is not None else None
        self._next_track_s = self._last_picture_s = -math.inf
        self._last_shown_s, self._connections, self._reason = math.nan, 0, ""
        self._held: list[Shown] | None = None
        self._ended_s, self._over, self._taken_here = math.inf, False, False
        self._begun_s = told.arrivals.now_s()
        #: why the last connection ended, or could not be opened
        self.fault: LiveFaultError | None = None
        self._stop = threading.Event()
        threading.Thread(target=self._run, name=f"live-{told.name}", daemon=True).start()

    @property
    def health(self) -> Health:
        """How it is now."""
        now_s = self._told.arrivals.now_s()
        silent_s = now_s - max(self._last_picture_s, self._begun_s)
        known: dict[str, Any] = {"connections": self._connections, "basis": self.clock.basis}
        if self._over:
            return Health("over", silent_s, reason=self._reason, **known)
        if not math.isfinite(self._last_picture_s):
            return Health("waiting", silent_s, reason=self._reason, **known)
        if silent_s > self._told.live.stall:
            return Health("silent", silent_s, reason=self._reason, **known)
        return Health("flows", silent_s, **known)

    @property
    def azimuth_reading(self) -> AzimuthReading | None:
        """What the angles in KLV count from, by what came so far."""
        return self._window.reading() if self._window is not None and len(self._window) else None

    def stop(self) -> None:
        """Read no more; a connection that is being opened is let go later."""
        self._stop.set()
        self._pictures.end()

    def _run(self) -> None:
        pauses = self._pauses()
        while not self._stop.is_set():
            try:
                self._connect_and_read()
            except LiveFaultError as fault:
                self._has_ended(fault)
            except Exception as error:  # of what came: it must not end the mission
                self._has_ended(LiveFaultError(f"{type(error).__name__}"))
            if self._taken_here:
                pauses = self._pauses()
            if self._told.arrivals.now_s() - self._ended_s > self._told.live.over_after:
                self._over = True
                self._pictures.end()
                return
            self._stop.wait(next(pauses))

    def _pauses(self) -> Iterator[float]:
        """Whoever listens does so at once again; a server is not called without end."""
        url = self._told.url
        if url.scheme == "udp" or "listen" in url.query or url.query.get("mode") == "listener":
            return repeat(_PAUSES_S[0])
        return chain(_PAUSES_S, repeat(_LONGEST_PAUSE_S))

    def _connect_and_read(self) -> None:
        live, arrivals = self._told.live, self._told.arrivals
        self._taken_here, self._held = False, []
        connection = connect(self._told.url, live.reconnect, live.reconnect, arrivals.now_s)
        try:
            self._connections += 1
            self.clock.restart()
            self._pictures.restart(connection)
            _LOG.event("stream opened", stream=self._told.name, connection=self._connections)
            recorder = self._told.recorder
            if recorder is not None:
                recorder.begin(connection.stream)
            for item in connection.items(None if recorder is None else recorder.keep):
                if self._stop.is_set():
                    return
                self._take(item, connection)
        finally:
            if self._told.recorder is not None:
                self._told.recorder.end()
            connection.close()

    def _has_ended(self, fault: LiveFaultError) -> None:
        self._reason = str(fault)
        self.fault = fault
        # a sender that is called in vain has said nothing new
        if fault.ended and self._taken_here:
            self._ended_s = self._told.arrivals.now_s()
        _LOG.event("stream broke off", stream=self._told.name, reason=self._reason)

    def _take(self, item: Shown | KlvBytes, connection: Connection) -> None:
        if isinstance(item, KlvBytes):
            self._take_klv(item)
            return
        if math.isfinite(item.shown_s):
            self.clock.heard(item.shown_s, item.arrival_s)
            self._last_shown_s = item.shown_s
        if math.isfinite(item.ntp_s):
            taken_s = self._told.arrivals.of_utc_s(item.ntp_s)
            self.clock.refer("ntp", item.shown_s, taken_s, item.arrival_s)
        self._last_picture_s, self._ended_s, self._taken_here = item.arrival_s, math.inf, True
        self._pass_on(item, connection)

    def _pass_on(self, shown: Shown, connection: Connection) -> None:
        """To the pictures, once it is settled when they were taken."""
        waiting = [shown] if self._held is None else [*self._held, shown]
        since_s = shown.arrival_s - waiting[0].arrival_s
        if self._held is not None and self.clock.basis == "arrival" and since_s < _SETTLES_S:
            self._held = waiting
            return
        self._held = None
        for one in waiting:
            taken_s = self.clock.taken_s(one.shown_s)
            if self._told.recorder is not None and one.frame is not None:
                self._told.recorder.taken(taken_s, one.shown_s)
            self._pictures.take(one, taken_s, connection)

    def _take_klv(self, item: KlvBytes) -> None:
        if self._window is None:
            return
        shown_s = item.shown_s if math.isfinite(item.shown_s) else self._last_shown_s
        first_s = math.nan
        for packet, stamp_s in self._window.stamps_s(item.data):
            first_s = stamp_s if math.isnan(first_s) else first_s
            since_s = stamp_s - first_s if 0.0 <= stamp_s - first_s < 10.0 else 0.0
            self.clock.refer("klv", shown_s + since_s, self._told.arrivals.of_utc_s(stamp_s), item.arrival_s)
            taken_s = self.clock.taken_s(shown_s + since_s)
            if math.isfinite(taken_s):
                self._window.add(taken_s, packet)
        if len(self._window) and item.arrival_s >= self._next_track_s:
            self._next_track_s = item.arrival_s + _TRACK_S
            try:
                self._told.on_track(self._window.track())
            except InputError as error:
                _LOG.warning("no pose", stream=self._told.name, found=error.found)

"""KLV that comes with the pictures: its newest samples as a track."""

from __future__ import annotations

import math
from collections import deque
from pathlib import Path

from pipeline.config.telemetry import Telemetry
from pipeline.ingest.samples import LeftOut
from pipeline.ingest.telemetry.misb_azimuth import Reading
from pipeline.ingest.telemetry.misb_klv import FIRST_DATE_US, reading_of, track_of_packets
from pipeline.ingest.telemetry.misb_packets import MisbPacket, packets_of
from pipeline.ingest.track import Track

#: samples before this are of no picture any more, seconds
WINDOW_S = 10.0


class KlvWindow:
    """telemetry: what the mission says of it. where: how errors call the stream."""

    def __init__(self, telemetry: Telemetry, where: str) -> None:
        self._telemetry, self._where = telemetry, Path(where)
        self._packets: deque[tuple[float, MisbPacket]] = deque()
        self._taken = 0
        self.damaged = LeftOut()

    def stamps_s(self, data: bytes) -> list[tuple[MisbPacket, float]]:
        """The packets in a piece, each with its stamp, seconds since 1970; NaN for one whose clock was never set."""
        found = []
        for packet in packets_of([data], f"{self._where} piece {self._taken}", self.damaged):
            stamp_us = packet.fields.timestamp_us or 0
            found.append((packet, stamp_us * 1e-6 if stamp_us > FIRST_DATE_US else math.nan))
        self._taken += 1
        return found

    def add(self, time_s: float, packet: MisbPacket) -> None:
        """A packet and its time on the stream's clock."""
        self._packets.append((time_s, MisbPacket(self._taken, 0, packet.fields)))
        while self._packets[0][0] < time_s - WINDOW_S:
            self._packets.popleft()

    def track(self) -> Track:
        """Of the newest samples. Raises InputError if none can be used."""
        times_s = [time_s for time_s, _ in self._packets]
        packets = [packet for _, packet in self._packets]
        return track_of_packets(self._where, packets, times_s, self._telemetry, LeftOut())

    def reading(self) -> Reading | None:
        """What the camera's angles count from, by the newest samples; None where nothing tells."""
        return reading_of(self._where, [packet for _, packet in self._packets], self._telemetry, [])

    def __len__(self) -> int:
        return len(self._packets)

"""A flight that was mapped before this one: its accounts, as they stand in the summary of a map that goes on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.ingest.track import Clock
from pipeline.outputs.accounting import StreamAccount
from pipeline.outputs.times import iso_time


@dataclass(frozen=True)
class EarlierFlight:
    """number: from 1, in the order in which flights were mapped. mission_file: as its run was told. pace: of its run.

    start_ns, end_ns: of its pictures, on ``clock``. streams: what became of every frame. detections: boxes in all.
    not_taken: what its map did not take, reason -> count. fingerprints: of its streams' ways, sorted.
    """

    number: int
    mission: str
    mission_file: str
    pace: str
    clock: Clock
    start_ns: int
    end_ns: int
    streams: tuple[StreamAccount, ...]
    detections: int
    not_taken: Mapping[str, int]
    fingerprints: tuple[str, ...]

    @property
    def when(self) -> str:
        """From when to when."""
        return f"{iso_time(self.start_ns, self.clock)} to {iso_time(self.end_ns, self.clock)}"


def flight_to_json(flight: EarlierFlight) -> dict[str, Any]:
    """The record as plain values."""
    streams = [
        {"stream": s.stream, "captured": s.captured, "processed": s.processed, "dropped": dict(s.dropped)}
        for s in flight.streams
    ]
    names = ("number", "mission", "mission_file", "pace", "clock", "start_ns", "end_ns", "detections")
    plain = {name: getattr(flight, name) for name in names}
    return plain | {
        "when": flight.when,
        "streams": streams,
        "not_taken": dict(sorted(flight.not_taken.items())),
        "fingerprints": list(flight.fingerprints),
    }


def flight_from_json(values: Mapping[str, Any]) -> EarlierFlight:
    """The inverse; a sum of frames that does not hold raises ValueError."""
    fields = {name: value for name, value in values.items() if name != "when"}
    streams = tuple(StreamAccount(**account) for account in fields.pop("streams"))
    return EarlierFlight(**fields | {"streams": streams, "fingerprints": tuple(fields["fingerprints"])})

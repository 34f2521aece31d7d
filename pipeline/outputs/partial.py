"""A run that ended before its streams did: why, when, and where each stream was cut off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.outputs.times import iso_time


@dataclass(frozen=True)
class CutOff:
    """reached_s of length_s of the video were looked at, seconds from its start; last_ns: capture time there."""

    stream: str
    reached_s: float
    length_s: float
    last_ns: int

    @property
    def sentence(self) -> str:
        """Where, in words."""
        return f"{self.stream} was cut off at {self.reached_s:.1f} of {self.length_s:.1f} s"


@dataclass(frozen=True)
class Partial:
    """reason: such as ``stopped by SIGINT``. at_ns: when, by this machine's clock, ns UTC. cut_off: the streams."""

    reason: str
    at_ns: int
    cut_off: Sequence[CutOff]

    @property
    def sentence(self) -> str:
        """For the head of every output."""
        streams = "; ".join(cut.sentence for cut in self.cut_off) or "every stream had come to its end"
        return f"PARTIAL MAP: {self.reason} at {iso_time(self.at_ns)[:19]}Z; {streams}."


def partial_json(partial: Partial | None) -> dict[str, Any] | None:
    """As it stands in summary.json; None for a run that came to its end."""
    if partial is None:
        return None
    streams = [
        {
            "stream": cut.stream,
            "reached_s": round(cut.reached_s, 3),
            "length_s": round(cut.length_s, 3),
            "last_seen": iso_time(cut.last_ns),
        }
        for cut in partial.cut_off
    ]
    return {"reason": partial.reason, "at": iso_time(partial.at_ns), "cut_off": streams}

"""What happened during a run: who was lost and came back, and what was changed for it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TimelineEntry:
    """at_s: since the run began. what: one or two words. subject: of whom. detail: may be empty."""

    at_s: float
    what: str
    subject: str
    detail: str = ""

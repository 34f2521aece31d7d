"""How a live stream is waited for."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import model_validator

from pipeline.config.base import Strict, mismatch
from pipeline.config.units import Meters, PositiveSeconds, Seconds


class Live(Strict):
    """How a live stream is waited for, and what is done when it is silent."""

    wait: PositiveSeconds = 20.0
    """So long a mission that begins waits for the first picture and the first position."""
    stall: PositiveSeconds = 1.5
    """A silence of so long is said. At most two seconds."""
    reconnect: PositiveSeconds = 5.0
    """After a silence of so long the stream is opened anew, again and again, with longer and longer pauses."""
    over_after: PositiveSeconds = 30.0
    """A sender that ended the stream, and is not back after so long, is over; one that fell silent never is."""
    pose_wait: Seconds = 1.0
    """So long a picture waits for telemetry of its time, which comes later over some radios."""
    range: Meters = 500.0
    """So far from where it is when the mission begins the drone will fly: ground beyond is not on the map. A
    `search_area` is on it in any case.
    """
    record: Path | None = None
    """A folder on the node that plays the stream's site, in which the stream is kept as it comes. Absent: it is not
    kept, and places that were found have no picture. Example: `recordings/drone-1`.
    """
    clock: Literal["auto", "arrival"] = "auto"
    """When pictures were taken: as the stream says (RTCP, KLV), if that is within ten seconds of this machine's
    clock; `arrival`: as they arrive, for a sender whose clock is a little wrong.
    """

    @model_validator(mode="after")
    def _is_said_soon_and_opened_later(self) -> Live:
        if self.stall > 2.0:
            raise mismatch(f"{self.stall:g} s", "at most 2 s", ("stall",))
        if self.reconnect < self.stall:
            raise mismatch(f"{self.reconnect:g} s", f"at least the stall, {self.stall:g} s", ("reconnect",))
        return self

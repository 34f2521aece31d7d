"""How a live stream is, in words for its operator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pipeline.ingest.live.capture_clock import Basis

#: no picture yet; pictures come; none comes any more; the sender is gone for good
State = Literal["waiting", "flows", "silent", "over"]


@dataclass(frozen=True)
class Health:
    """silent_s: since the last picture. connections: that were opened. reason: why the last one ended, if it did.

    basis: what capture times rest on. pose_fault: why there are no poses now, if it is known.
    """

    state: State
    silent_s: float = 0.0
    connections: int = 0
    reason: str = ""
    basis: Basis = "arrival"
    pose_fault: str = ""

    @property
    def sentence(self) -> str:
        """In words."""
        why = f": {self.reason}" if self.reason else ""
        if self.state == "silent":
            return f"no picture for {self.silent_s:.1f} s{why}"
        if self.state == "over":
            return f"the sender ended it and did not come back{why}"
        if self.state == "waiting":
            return f"no picture yet{why}"
        return f"capture times {CAPTURE_TIMES[self.basis]}; connection {self.connections}"


CAPTURE_TIMES: dict[Basis, str] = {
    "ntp": "by the sender's clock (RTCP)",
    "klv": "by the stamps of its KLV",
    "arrival": "by arrival, late by the delay of the stream",
}

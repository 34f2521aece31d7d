"""Every frame is accounted for: captured = processed + dropped by reason."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class StreamAccount:
    """What became of the frames of one stream when the run is over.

    captured: frames of the video. processed: frames that at least one detector has looked at.
    dropped: the others, reason -> count, each at least 0. Raises ValueError if the sum does not hold.
    """

    stream: str
    captured: int
    processed: int
    dropped: Mapping[str, int]

    def __post_init__(self) -> None:
        object.__setattr__(self, "dropped", MappingProxyType(dict(sorted(self.dropped.items()))))
        counts = {"captured": self.captured, "processed": self.processed, **self.dropped}
        for name, count in counts.items():
            if count < 0:
                raise ValueError(f"stream {self.stream}: {name} is {count}; a count is at least 0")
        if self.captured != self.processed + self.dropped_total:
            raise ValueError(
                f"stream {self.stream}: {self.captured} frames captured, but {self.processed} processed "
                f"and {self.dropped_total} dropped"
            )

    @property
    def dropped_total(self) -> int:
        """Frames dropped for any reason."""
        return sum(self.dropped.values())

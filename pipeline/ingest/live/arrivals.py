"""The clock of what arrives: it never jumps, whatever is done to the machine's date."""

from __future__ import annotations

from dataclasses import dataclass, field

from pipeline.clock import Clock


@dataclass(frozen=True)
class Arrivals:
    """start_ns: its zero, ns since 1970. The date is asked once."""

    start_ns: int
    clock: Clock = field(default_factory=Clock)

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "_since_s", (self.clock.utc_ns() - self.start_ns) * 1e-9 - self.clock.monotonic_s()
        )

    def now_s(self) -> float:
        """Seconds since the zero."""
        since_s: float = self._since_s  # type: ignore[attr-defined]
        return since_s + self.clock.monotonic_s()

    def utc_s(self) -> float:
        """Seconds since 1970."""
        return self.start_ns * 1e-9 + self.now_s()

    def of_utc_s(self, utc_s: float) -> float:
        """Seconds since the zero of a date, seconds since 1970."""
        return utc_s - self.start_ns * 1e-9

"""Times as people on the ground read them: in their zone, which is named."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

from pipeline.ingest.track import Clock
from pipeline.outputs.times import iso_time, zone_name


@dataclass(frozen=True)
class LocalTimes:
    """zone: a name of the IANA data base; None: that of this machine. clock: of the times that are given to it.

    Only times on UTC can be taken to another zone: others are shown as they are, and said to be so.
    """

    clock: Clock = "utc"
    zone: str | None = None

    def __call__(self, time_ns: int) -> str:
        """``2026-05-01 12:00:00 CEST``; fractions are cut."""
        if self.clock != "utc":
            return f"{iso_time(time_ns, self.clock)[:19].replace('T', ' ')} {zone_name(self.clock)}"
        return f"{self._at(time_ns):%Y-%m-%d %H:%M:%S %Z}"

    def of_day(self, time_ns: int) -> str:
        """``12:00:00``, the time of day."""
        return self(time_ns)[11:19]

    def said(self, time_ns: int) -> str:
        """Which zone it is, and who says so, at a time of the mission."""
        if self.clock != "utc":
            return f"Times are {zone_name(self.clock)}, as the telemetry has them."
        at = self._at(time_ns)
        offset = f"{at:%z}"
        whose = (
            "of the machine that made this report" if self.zone is None else f"{self.zone}, by the mission"
        )
        return f"Times are {at:%Z} (UTC{offset[:3]}:{offset[3:5]}), {whose}."

    def _at(self, time_ns: int) -> datetime:
        utc = datetime.fromtimestamp(time_ns // 1_000_000_000, UTC)
        return utc.astimezone() if self.zone is None else utc.astimezone(ZoneInfo(self.zone))

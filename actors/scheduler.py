"""The scheduler actor: solves the allocation problem."""

from __future__ import annotations

from pipeline.allocation.plan import Plan
from pipeline.mission.planning import plan
from pipeline.mission.prepared import PreparedMission


class SchedulerActor:
    """Plans for one mission."""

    def __init__(self, prepared: PreparedMission) -> None:
        self._prepared = prepared

    def plan(self) -> Plan:
        """The optimal plan. Raises NoPlanError if there is none."""
        return plan(self._prepared)

"""The optimal plan of a prepared mission."""

from __future__ import annotations

from pipeline.allocation.decomposed import solve
from pipeline.allocation.explain import explain
from pipeline.allocation.plan import Plan
from pipeline.errors import NoPlanError, NoPlanInTimeError
from pipeline.logs import Log
from pipeline.mission.detectors import require_planned_layers
from pipeline.mission.prepared import PreparedMission

_LOG = Log("allocation")


def plan(prepared: PreparedMission) -> Plan:
    """The optimal plan. Raises NoPlanError if there is none, naming the limits that clash."""
    limit_s = prepared.mission.processing.time_limit
    result = solve(prepared.problem, time_limit_s=limit_s)
    if result.status == "infeasible":
        raise NoPlanError(
            f"{prepared.path}: no allocation satisfies the mission: {explain(prepared.problem).text}"
        )
    if result.status == "unknown":
        raise NoPlanInTimeError(
            f"{prepared.path} processing.time_limit: found no plan within {limit_s:g} s; expected more time"
        )
    _LOG.event(
        "planned",
        status=result.status,
        objective=result.objective,
        solve_s=round(result.solve_s, 3),
        assignments=[f"{a.stream} -> {a.detector}" for a in result.assignments],
    )
    for assignment in result.assignments:
        prepared.runnable(assignment.pool_detector)
    require_planned_layers(prepared.layers, prepared.known_layers, result.assignments, prepared.path)
    return result

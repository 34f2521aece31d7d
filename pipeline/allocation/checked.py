"""The door of the room: no plan leaves it that breaks a limit of its problem."""

from __future__ import annotations

from pipeline.allocation.plan import Plan
from pipeline.allocation.problem import Problem
from pipeline.allocation.validate import validate
from pipeline.errors import InvalidPlanError

_MOST_FAULTS = 3


def checked(problem: Problem, plan: Plan) -> Plan:
    """The plan itself, if it keeps every limit of the problem.

    Raises InvalidPlanError, which names the first faults.
    """
    faults = validate(problem, plan)
    if faults:
        more = f"; and {len(faults) - _MOST_FAULTS} more" if len(faults) > _MOST_FAULTS else ""
        raise InvalidPlanError(f"the plan found is not valid: {'; '.join(faults[:_MOST_FAULTS])}{more}")
    return plan

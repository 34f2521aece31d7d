"""A plan: what a solver found, as records, as JSON and as a table."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

from pipeline.allocation.problem import Problem
from pipeline.errors import InputError
from pipeline.link.codec import Codec
from pipeline.sensor.setup import PLAIN, Setup, setup_from
from pipeline.storage.versions import require_version, stamp

Status = Literal["optimal", "feasible", "infeasible", "unknown"]
PLAN_COLUMNS = ("stream", "detector", "machine", "site", "every", "first frame", "bitrate", "link use")


@dataclass(frozen=True)
class Assignment:
    """One substream: the frames f with ``f mod period = phase``, encoded for one detector alone.

    detector: ``MACHINE:DETECTOR``. pool_detector: its id in the pool. phase: 0 .. period - 1.
    bitrate_bps: the level as if every frame were sent; the substream itself takes ``bitrate_bps / period``.
    codec: of the substream; empty for the mission's one. setup: how the network is run there.
    """

    stream: str
    detector: str
    pool_detector: str
    machine: str
    site: str
    period: int
    phase: int
    bitrate_bps: float
    codec: Codec | Literal[""] = ""
    setup: Setup = PLAIN

    @property
    def substream_bps(self) -> float:
        """What Eq. ilp_contr_bw charges to the link."""
        return self.bitrate_bps / self.period


@dataclass(frozen=True)
class Plan:
    """A solver's answer.

    status: ``optimal`` and ``infeasible`` are proven; ``feasible`` and ``unknown`` (no plan yet) mean that
    the time limit came first. objective: Eq. objective, with the bitrate divided by the largest level. bound:
    no plan has a greater objective. gap: (bound - objective) / max(1, abs(objective)). All three are None
    without a plan. cycle: frames until the schedule repeats. assignments: ordered by stream, phase and
    detector. solve_s: wall time. variables, constraints: the size of the solved model, by its own count.
    """

    status: Status
    objective: float | None
    bound: float | None
    gap: float | None
    cycle: int
    assignments: tuple[Assignment, ...]
    solve_s: float
    variables: int
    constraints: int


def objective(problem: Problem, assignments: tuple[Assignment, ...]) -> float:
    """Eq. objective: acc_obj * w - penalty * (1 - w), linkUsed being 1 for each site a stream is sent to."""
    detectors = {detector.id: detector for detector in problem.detectors}
    gains = (problem.gain(a.stream, detectors[a.detector], _level(problem, a)) for a in assignments)
    links_used = len({(a.stream, a.site) for a in assignments})
    return sum(gains) * problem.accuracy_weight - links_used * (1.0 - problem.accuracy_weight)


def _level(problem: Problem, assignment: Assignment) -> int:
    level = problem.level(assignment.bitrate_bps, assignment.codec)
    if level is None:
        raise ValueError(f"{assignment} is at no level of the problem")
    return level


def plan_to_json(plan: Plan, problem: Problem) -> str:
    """The plan, and the limits it was made under, as a JSON document."""
    document = stamp("plan") | {"plan": asdict(plan), "problem": _limits(problem)}
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def _limits(problem: Problem) -> dict[str, Any]:
    """What a reader needs to judge the plan. Infinite is null: JSON has no infinity."""
    return {
        "frame_rate_hz": problem.frame_rate_hz,
        "detectors_per_stream": problem.detectors_per_stream,
        "detectors_per_frame": problem.detectors_per_frame,
        "accuracy_weight": problem.accuracy_weight,
        "memory_rule": problem.memory_rule,
        "bitrates_bps": list(problem.bitrates_bps),
        "streams": list(problem.streams),
        "machines": [
            {"id": m.id, "site": m.site, "memory_bytes": _finite(m.memory_bytes)} for m in problem.machines
        ],
        "links": [
            {"stream": stream, "site": site, "bandwidth_bps": _finite(problem.link(stream, site))}
            for stream in problem.streams
            for site in problem.sites
        ],
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def plan_from_json(text: str, where: object) -> Plan:
    """The plan of a document written by plan_to_json. Raises InputError; ``where`` names the file."""
    try:
        document = json.loads(text)
        record = document["plan"]
        record["assignments"] = tuple(_assignment(a) for a in record["assignments"])
        plan = Plan(**record)
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            where, f"a document that is no plan ({error})", "a file written as plan.json"
        ) from None
    require_version(document, "plan", where)
    if plan.status not in get_args(Status):
        raise InputError(f"{where} plan.status", repr(plan.status), f"one of {', '.join(get_args(Status))}")
    return plan


def _assignment(record: dict[str, Any]) -> Assignment:
    """Plans from before there were setups have none."""
    return Assignment(**{**record, "setup": setup_from(record.get("setup", {}))})


def assignment_to_json(assignment: Assignment) -> str:
    """One assignment in one line."""
    return json.dumps(asdict(assignment), allow_nan=False, sort_keys=True)


def assignment_from_json(text: str) -> Assignment:
    """The assignment of a line written by assignment_to_json."""
    return _assignment(json.loads(text))


def plan_table(plan: Plan) -> list[tuple[str, ...]]:
    """One row of text per assignment, under PLAN_COLUMNS."""
    return [
        (
            a.stream,
            a.pool_detector,
            a.machine,
            a.site,
            "frame" if a.period == 1 else f"{a.period} frames",
            str(a.phase),
            f"{a.bitrate_bps / 1e6:g} Mbps" + (f" {a.codec}" if a.codec else ""),
            f"{a.substream_bps / 1e6:g} Mbps",
        )
        for a in plan.assignments
    ]

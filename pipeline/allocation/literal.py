"""The paper's integer program as printed, in CP-SAT: the oracle that a faster solver is held against.

Readings where the text is open or slips (see the numbered notes beside the paper):

- Eq. ilp_frame_timing: a window has ``period_d`` frames, not ``period_d + 1``; k = 0 .. cp_lcm - period_d.
- ``sum_b x_vdb <= 1`` is added. The text says that it follows; for periods of 2 and more it does not.
- The bitrate in the objective is divided by the largest level (``Problem.gain``).
- M in Eq. ilp_contr_link is detPerStream: |S| is too small when detPerStream is greater.

What goes past the paper (``Detector.sharing``, ``Problem.deadline``) adds variables and constraints only
where it is used.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from ortools.sat.python import cp_model

from pipeline.allocation.checked import checked
from pipeline.allocation.plan import Assignment, Plan, Status, objective
from pipeline.allocation.problem import OBJECTIVE_RESOLUTION, MachineLimit, Problem, memory_units
from pipeline.errors import NoPlanError

#: four times the paper's largest instance
MAX_VARIABLES = 3_000_000
_UNLIMITED = 2**62

_STATUS: dict[cp_model.CpSolverStatus, Status] = {
    cp_model.OPTIMAL: "optimal",
    cp_model.FEASIBLE: "feasible",
    cp_model.INFEASIBLE: "infeasible",
    cp_model.UNKNOWN: "unknown",
}


@dataclass(frozen=True)
class LiteralModel:
    """The variables of Table ilp_variables, by index.

    x[v][d][b], y[v][d][f] and link_used[v][s]. added: how many constraints of ``model`` are not the paper's.
    """

    model: cp_model.CpModel
    x: list[list[list[cp_model.IntVar]]]
    y: list[list[list[cp_model.IntVar]]]
    link_used: list[list[cp_model.IntVar]]
    added: int


def number_of_variables(problem: Problem) -> int:
    """Eq. number_of_vars."""
    per_detector = len(problem.bitrates_bps) + problem.cycle
    return len(problem.streams) * (len(problem.detectors) * per_detector + len(problem.sites))


def number_of_constraints(problem: Problem) -> int:
    """Eq. number_of_contr. The model has ``LiteralModel.added`` more."""
    per_stream = 1 + 2 * (problem.cycle + len(problem.sites))
    windows = sum(problem.cycle - detector.period + 1 for detector in problem.detectors)
    return len(problem.machines) + len(problem.streams) * (per_stream + windows)


def solve(problem: Problem, *, time_limit_s: float, workers: int = 1, seed: int = 0) -> Plan:
    """The best plan. The same problem gives the same plan, unless the time limit ends the search.

    More than one worker take turns in a fixed order, since else luck would decide which of several equal
    optima is found. One worker is usually the fastest. Raises NoPlanError for a model of over MAX_VARIABLES.
    """
    if number_of_variables(problem) > MAX_VARIABLES:
        raise NoPlanError(
            f"the integer program would have {number_of_variables(problem)} variables, more than "
            f"{MAX_VARIABLES}: its cycle has {problem.cycle} frames; lower detectors_per_stream"
        )
    start = time.perf_counter()
    literal = build_model(problem)
    solver = cp_model.CpSolver()
    solver.parameters.max_time_in_seconds = time_limit_s
    solver.parameters.catch_sigint_signal = False  # else it takes Ctrl-C for itself, and keeps it
    solver.parameters.num_workers = workers
    solver.parameters.interleave_search = workers > 1
    solver.parameters.random_seed = seed
    solver.parameters.relative_gap_limit = 0.0
    solver.parameters.absolute_gap_limit = 0.0
    status = solver.solve(literal.model)
    if status not in _STATUS:
        raise ValueError(f"CP-SAT refused the model: {literal.model.validate()}")
    return _plan(problem, literal, solver, _STATUS[status], time.perf_counter() - start)


def _plan(
    problem: Problem, literal: LiteralModel, solver: cp_model.CpSolver, status: Status, solve_s: float
) -> Plan:
    size = (number_of_variables(problem), number_of_constraints(problem))
    if status in ("infeasible", "unknown"):
        return Plan(status, None, None, None, problem.cycle, (), solve_s, *size)
    assignments = _assignments(problem, literal, solver)
    value = objective(problem, assignments)
    slack = (solver.best_objective_bound - solver.objective_value) * OBJECTIVE_RESOLUTION
    bound, gap = value + slack, slack / max(1.0, abs(value))
    return checked(problem, Plan(status, value, bound, gap, problem.cycle, assignments, solve_s, *size))


def _assignments(
    problem: Problem, literal: LiteralModel, solver: cp_model.CpSolver
) -> tuple[Assignment, ...]:
    found = [
        Assignment(
            stream,
            detector.id,
            detector.detector,
            detector.machine,
            detector.site,
            detector.period,
            next(f for f, y in enumerate(literal.y[v][d]) if solver.boolean_value(y)),
            problem.bitrates_bps[b],
            problem.codec(b),
            detector.setup,
        )
        for v, stream in enumerate(problem.streams)
        for d, detector in enumerate(problem.detectors)
        for b, x in enumerate(literal.x[v][d])
        if solver.boolean_value(x)
    ]
    return tuple(sorted(found, key=lambda a: (a.stream, a.phase, a.detector)))


def build_model(problem: Problem) -> LiteralModel:
    """All variables, all constraints and the objective."""
    literal = _variables(problem)
    for v in range(len(problem.streams)):
        _detectors_per_stream(problem, literal, v)
        _detectors_per_frame(problem, literal, v)
        _frame_timing(problem, literal, v)
        _bandwidth(problem, literal, v)
        _links_used(problem, literal, v)
        _deadline(problem, literal, v)
    for machine in problem.machines:
        _memory(problem, literal, machine)
        _sharing(problem, literal, machine)
    _one_bitrate(literal)
    _objective(problem, literal)
    return literal


def _variables(problem: Problem) -> LiteralModel:
    model = cp_model.CpModel()
    streams, detectors = range(len(problem.streams)), range(len(problem.detectors))
    levels, frames = range(len(problem.bitrates_bps)), range(problem.cycle)
    sites = range(len(problem.sites))
    return LiteralModel(
        model,
        [[[model.new_bool_var(f"x_{v}_{d}_{b}") for b in levels] for d in detectors] for v in streams],
        [[[model.new_bool_var(f"y_{v}_{d}_{f}") for f in frames] for d in detectors] for v in streams],
        [[model.new_int_var(0, len(problem.sites), f"link_{v}_{s}") for s in sites] for v in streams],
        added=len(streams) * len(detectors),
    )


def _sum_between(
    literal: LiteralModel, terms: list[tuple[cp_model.IntVar, int]], low: int, high: int
) -> None:
    weighted = cp_model.LinearExpr.weighted_sum([var for var, _ in terms], [factor for _, factor in terms])
    literal.model.add_linear_constraint(weighted, low, high)


def _detectors_per_stream(problem: Problem, literal: LiteralModel, v: int) -> None:
    """Eq. ilp_constr_detperstream."""
    terms = [(x, 1) for of_detector in literal.x[v] for x in of_detector]
    _sum_between(literal, terms, 0, problem.detectors_per_stream)


def _detectors_per_frame(problem: Problem, literal: LiteralModel, v: int) -> None:
    """Eq. ilp_constr_detperframe; its two sides are two constraints, as Eq. number_of_contr counts them."""
    for f in range(problem.cycle):
        terms = [(y[f], 1) for y in literal.y[v]]
        _sum_between(literal, terms, 1, _UNLIMITED)
        _sum_between(literal, terms, 0, problem.detectors_per_frame)


def _frame_timing(problem: Problem, literal: LiteralModel, v: int) -> None:
    """Eq. ilp_frame_timing: in period_d frames a used detector starts once, an unused one never."""
    for d, detector in enumerate(problem.detectors):
        used = [(x, -1) for x in literal.x[v][d]]
        for k in range(problem.cycle - detector.period + 1):
            starts = [(y, 1) for y in literal.y[v][d][k : k + detector.period]]
            _sum_between(literal, starts + used, 0, 0)


def _bandwidth(problem: Problem, literal: LiteralModel, v: int) -> None:
    """Eq. ilp_contr_bw, multiplied by cp_lcm."""
    for site in problem.sites:
        terms = [
            (x, round(bitrate) * (problem.cycle // detector.period))
            for d, detector in enumerate(problem.detectors)
            if detector.site == site
            for x, bitrate in zip(literal.x[v][d], problem.bitrates_bps, strict=True)
        ]
        link_bps = problem.link(problem.streams[v], site)
        high = _UNLIMITED if math.isinf(link_bps) else round(link_bps) * problem.cycle
        _sum_between(literal, terms, 0, high)


def _links_used(problem: Problem, literal: LiteralModel, v: int) -> None:
    """Eq. ilp_contr_link with M = detPerStream."""
    for s, site in enumerate(problem.sites):
        at_site = [
            (x, 1) for d, of in enumerate(literal.x[v]) if problem.detectors[d].site == site for x in of
        ]
        link = (literal.link_used[v][s], -problem.detectors_per_stream)
        _sum_between(literal, [*at_site, link], -_UNLIMITED, 0)


def _memory(problem: Problem, literal: LiteralModel, machine: MachineLimit) -> None:
    """Eq. ilp_contr_ram, or Eq. ilp_contr_ram_simpl."""
    one_only = problem.memory_rule == "one_detector_per_machine"
    terms = [
        (x, 1 if one_only else memory_units(detector.memory_bytes))
        for of_stream in literal.x
        for d, detector in enumerate(problem.detectors)
        if detector.machine == machine.id
        for x in of_stream[d]
    ]
    if math.isinf(machine.memory_bytes):
        high = _UNLIMITED
    else:
        high = 1 if one_only else memory_units(machine.memory_bytes)
    _sum_between(literal, terms, 0, high)


def _deadline(problem: Problem, literal: LiteralModel, v: int) -> None:
    """Past the paper: what would come too late is not used."""
    for d, detector in enumerate(problem.detectors):
        for b, x in enumerate(literal.x[v][d]):
            if not problem.in_time(problem.streams[v], detector, b):
                literal.model.add(x == 0)


def _sharing(problem: Problem, literal: LiteralModel, machine: MachineLimit) -> None:
    """Past the paper: a detector whose times hold for ``sharing`` detectors keeps the others' number down."""
    here = [d for d, detector in enumerate(problem.detectors) if detector.machine == machine.id]
    everything = [x for of_stream in literal.x for d in here for x in of_stream[d]]
    for sharing in sorted({k for d in here if (k := problem.detectors[d].sharing) is not None}):
        used = literal.model.new_bool_var(f"sharing_{machine.id}_{sharing}")
        for of_stream in literal.x:
            for d in here:
                if problem.detectors[d].sharing == sharing:
                    literal.model.add(sum(of_stream[d]) <= used)
        literal.model.add(sum(everything) <= sharing).only_enforce_if(used)


def _one_bitrate(literal: LiteralModel) -> None:
    """``sum_b x_vdb <= 1``: not printed, but meant ("ensures that only one bitrate level b is used")."""
    for of_stream in literal.x:
        for of_detector in of_stream:
            literal.model.add_at_most_one(of_detector)


def _objective(problem: Problem, literal: LiteralModel) -> None:
    """Eq. objective."""
    gains = [
        (x, problem.gain_units(stream, detector, b))
        for stream, of_stream in zip(problem.streams, literal.x, strict=True)
        for d, detector in enumerate(problem.detectors)
        for b, x in enumerate(of_stream[d])
    ]
    links = [(link, -problem.penalty_units) for of_stream in literal.link_used for link in of_stream]
    terms = gains + links
    literal.model.maximize(
        cp_model.LinearExpr.weighted_sum([var for var, _ in terms], [factor for _, factor in terms])
    )

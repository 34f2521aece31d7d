"""An independent check of a plan, frame by frame and link by link; it shares no code with the solvers."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator

from pipeline.allocation.plan import Assignment, Plan
from pipeline.allocation.problem import Detector, Problem

#: solvers round to whole bits per second, kilobytes and 1e-9 of objective
_BPS_TOLERANCE = 1.0
_BYTES_TOLERANCE = 1000.0
_OBJECTIVE_TOLERANCE = 1e-6
_TIME_TOLERANCE_S = 1e-6


def validate(problem: Problem, plan: Plan) -> list[str]:
    """Every fault of the plan, one line each; empty for a plan that keeps all limits.

    An infeasible or unknown answer is faultless if it assigns nothing; whether it is true is not checked
    here.
    """
    if plan.status in ("infeasible", "unknown"):
        return [f"status {plan.status} with {len(plan.assignments)} assignments"] if plan.assignments else []
    unknown = list(_unknown_names(problem, plan))
    if unknown:
        return unknown
    checks = (_detectors, _frames, _streams, _links, _late, _machines, _sharing, _objective)
    return [fault for check in checks for fault in check(problem, plan)]


def _unknown_names(problem: Problem, plan: Plan) -> Iterator[str]:
    known, streams = {detector.id for detector in problem.detectors}, set(problem.streams)
    for a in plan.assignments:
        if a.stream not in streams:
            yield f"stream {a.stream}: not in the problem"
        if a.detector not in known:
            yield f"detector {a.detector}: not in the problem"
        if _number_of_level(problem, a) is None:
            at = f"{a.bitrate_bps:g} bps" + (f" {a.codec}" if a.codec else "")
            yield f"{a.stream} on {a.detector}: bitrate {at} is no level of the problem"


def _detectors(problem: Problem, plan: Plan) -> Iterator[str]:
    """Each assignment repeats what the problem says of its detector, and no stream uses a detector twice."""
    by_id = {detector.id: detector for detector in problem.detectors}
    for a in plan.assignments:
        d = by_id[a.detector]
        said = (a.pool_detector, a.machine, a.site, a.period)
        if said != (d.detector, d.machine, d.site, d.period):
            yield f"{a.stream} on {a.detector}: {said} is not what the problem says of the detector"
        if a.setup != d.setup:
            yield f"{a.stream} on {a.detector}: {a.setup} is not the setup that the problem says"
        if not 0 <= a.phase < a.period:
            yield f"{a.stream} on {a.detector}: phase {a.phase} outside 0 .. {a.period - 1}"
    for (stream, detector), uses in Counter((a.stream, a.detector) for a in plan.assignments).items():
        if uses > 1:
            yield f"{stream} uses {detector} {uses} times"


def _frames(problem: Problem, plan: Plan) -> Iterator[str]:
    """Every frame of two cycles gets 1 .. detPerFrame detectors, and no detector starts while it works.

    The cycle of a stream is that of its own periods: afterwards all repeats.
    """
    if plan.cycle != problem.cycle:
        yield f"cycle of {plan.cycle} frames, the periods give {problem.cycle}"
    of_stream: dict[str, list[Assignment]] = defaultdict(list)
    for a in plan.assignments:
        of_stream[a.stream].append(a)
    for stream in problem.streams:
        assigned = of_stream[stream]
        busy_until = dict.fromkeys((a.detector for a in assigned), 0)
        for frame in range(2 * math.lcm(*(a.period for a in assigned))):
            looks = 0
            for a in assigned:
                if frame >= a.phase and (frame - a.phase) % a.period == 0:
                    looks += 1
                    if frame < busy_until[a.detector]:
                        yield f"{stream} frame {frame}: {a.detector} is busy until {busy_until[a.detector]}"
                    busy_until[a.detector] = frame + a.period
            if not 1 <= looks <= problem.detectors_per_frame:
                yield f"{stream} frame {frame}: {looks} detectors, not 1 to {problem.detectors_per_frame}"


def _streams(problem: Problem, plan: Plan) -> Iterator[str]:
    for stream, detectors in Counter(a.stream for a in plan.assignments).items():
        if detectors > problem.detectors_per_stream:
            yield f"{stream}: {detectors} detectors, at most {problem.detectors_per_stream} are allowed"


def _links(problem: Problem, plan: Plan) -> Iterator[str]:
    """What a link carries: the frames of one period, each of which has bitrate / period of the bits."""
    sent: dict[tuple[str, str], float] = defaultdict(float)
    for a in plan.assignments:
        frames = sum(1 for frame in range(a.period) if frame % a.period == a.phase)
        sent[a.stream, a.site] += a.bitrate_bps * frames / a.period
    for (stream, site), bps in sent.items():
        bandwidth_bps = problem.link_bps.get((stream, site), 0.0)
        if bps > bandwidth_bps + (_BPS_TOLERANCE if bandwidth_bps else 0.0):
            yield f"link {stream} -> {site}: {bps:g} bps over {bandwidth_bps:g} bps"


def _machines(problem: Problem, plan: Plan) -> Iterator[str]:
    by_id: dict[str, Detector] = {detector.id: detector for detector in problem.detectors}
    on_machine: dict[str, list[Detector]] = defaultdict(list)
    for a in plan.assignments:
        on_machine[by_id[a.detector].machine].append(by_id[a.detector])
    for machine in problem.machines:
        here = on_machine[machine.id]
        if math.isinf(machine.memory_bytes):
            continue
        if problem.memory_rule == "one_detector_per_machine":
            if len(here) > 1:
                yield f"machine {machine.id}: {len(here)} detectors, 1 is allowed"
        elif sum(d.memory_bytes for d in here) > machine.memory_bytes + _BYTES_TOLERANCE * (1 + len(here)):
            total = sum(d.memory_bytes for d in here)
            yield f"machine {machine.id}: {total:g} bytes of {machine.memory_bytes:g}"


def _late(problem: Problem, plan: Plan) -> Iterator[str]:
    """With a deadline: capture to result, with what the largest packet takes on its link."""
    if problem.deadline is None:
        return
    by_id = {detector.id: detector for detector in problem.detectors}
    for a in plan.assignments:
        seconds = by_id[a.detector].execution_s
        bandwidth_bps = problem.link_bps.get((a.stream, a.site), 0.0)
        if not math.isinf(bandwidth_bps):
            frame_bits = a.bitrate_bps / problem.frame_rate_hz * problem.deadline.burst
            seconds += problem.deadline.encode_s + problem.deadline.decode_s + frame_bits / bandwidth_bps
        if seconds > problem.deadline.limit_s + _TIME_TOLERANCE_S:
            limit_s = problem.deadline.limit_s
            yield f"{a.stream} on {a.detector}: {seconds:g} s to a result, {limit_s:g} s allowed"


def _sharing(problem: Problem, plan: Plan) -> Iterator[str]:
    """No detector shares its machine with more others than its times hold for."""
    by_id = {detector.id: detector for detector in problem.detectors}
    together = Counter(a.machine for a in plan.assignments)
    for a in plan.assignments:
        sharing = by_id[a.detector].sharing
        if sharing is not None and together[a.machine] > sharing:
            yield f"{a.detector}: one of {together[a.machine]} on its machine, its times hold for {sharing}"


def _objective(problem: Problem, plan: Plan) -> Iterator[str]:
    """The stated objective is what the assignments are worth, and the bound is not below it."""
    if plan.objective is None or plan.bound is None:
        yield "a plan without an objective or a bound"
        return
    worth = _worth(problem, plan.assignments)
    if abs(worth - plan.objective) > _OBJECTIVE_TOLERANCE:
        yield f"objective {plan.objective!r}, the assignments are worth {worth!r}"
    if plan.bound < plan.objective - _OBJECTIVE_TOLERANCE:
        yield f"bound {plan.bound!r} below the objective {plan.objective!r}"


def _worth(problem: Problem, assignments: tuple[Assignment, ...]) -> float:
    accuracy, top_bps = 0.0, max(problem.bitrates_bps)
    by_id = {detector.id: detector for detector in problem.detectors}
    for a in assignments:
        detector = by_id[a.detector]
        level = _number_of_level(problem, a)
        assert level is not None
        of_stream = problem.stream_accuracy.get((a.stream, detector.detector), detector.accuracy)
        accuracy += a.bitrate_bps / top_bps / detector.period * of_stream[level]
    sites = len({(a.stream, a.site) for a in assignments})
    return problem.accuracy_weight * accuracy - (1.0 - problem.accuracy_weight) * sites


def _number_of_level(problem: Problem, a: Assignment) -> int | None:
    codecs = problem.codecs or [""] * len(problem.bitrates_bps)
    levels = list(zip(problem.bitrates_bps, codecs, strict=True))
    return levels.index((a.bitrate_bps, a.codec)) if (a.bitrate_bps, a.codec) in levels else None

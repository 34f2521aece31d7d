"""The literal model in a process of its own, which is ended when its time is over.

CP-SAT's time limit does not cover the building of the model, which takes longer than most cells' limit where
there are half a million variables; and its memory goes back with the process.
"""

from __future__ import annotations

import multiprocessing
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection

from pipeline.allocation import literal
from pipeline.allocation.plan import Status
from pipeline.allocation.problem import Problem

#: CP-SAT needs some time to stop and to say how far it is
_GRACE_S = 5.0


@dataclass(frozen=True)
class Answer:
    """What a solver found. objective and gap are None without a plan, as in ``Plan``.

    seconds: wall time, the building of the model included. cpu_seconds: of the process, None if it was ended.
    """

    status: Status
    objective: float | None
    gap: float | None
    seconds: float
    cpu_seconds: float | None

    @property
    def proven(self) -> bool:
        """Whether the solver came to an end: an optimum, or that there is none."""
        return self.status in ("optimal", "infeasible")


def solve_literal(problem: Problem, limit_s: float) -> Answer:
    """Solve with one worker; ``unknown`` if the process had to be ended, by us or by the system."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_solve, args=(problem, limit_s, there), daemon=True)
    process.start()
    there.close()
    begun = time.perf_counter()
    try:
        here.recv()
        begun = time.perf_counter()
        if here.poll(limit_s + _GRACE_S):
            found: Answer = here.recv()
            return found
    except EOFError:
        pass  # killed by the system, for want of memory
    finally:
        process.kill()
        process.join()
    return Answer("unknown", None, None, time.perf_counter() - begun, None)


def _solve(problem: Problem, limit_s: float, reply: Connection) -> None:
    reply.send("the imports are done")
    begun_s = time.process_time()
    plan = literal.solve(problem, time_limit_s=limit_s)
    cpu_s = time.process_time() - begun_s
    reply.send(Answer(plan.status, plan.objective, plan.gap, plan.solve_s, cpu_s))

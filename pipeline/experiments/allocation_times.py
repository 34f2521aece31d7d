"""Every cell of the paper's Tables ilp_eval1 and ilp_eval2: its time, the literal model's and ours."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pipeline.allocation import decomposed
from pipeline.allocation.problem import Problem
from pipeline.allocation.validate import validate
from pipeline.errors import InputError
from pipeline.experiments.literal_process import Answer, solve_literal
from pipeline.experiments.paper_instance import PaperInstance
from pipeline.experiments.paper_tables import CELLS, Cell
from pipeline.storage.whole_or_nothing import write_text

Progress = Callable[[str, int, int, str], None]

#: a minute's worth
QUICK_CELLS = tuple(cell for cell in CELLS if cell.streams <= 2 and cell.detectors_per_stream <= 3)
QUICK_LITERAL_LIMIT_S = 2.0
#: ours is the fastest of so many: what else the machine does comes and goes
REPEATS = 3
_LIMIT_S = 60.0
_OBJECTIVE_TOLERANCE = 1e-6
#: a cell that goes through all of the solver's compiled code
_WARM_UP = "ilp_eval1a-dps3-v25"


@dataclass(frozen=True)
class CellResult:
    """What was measured for a cell.

    size: variables and constraints by the paper's formulas. ours: the fastest of REPEATS. master: columns and
    rows of ours. faults: what ``validate`` says of our plan. literal: None if it was not asked for.
    """

    cell: Cell
    size: tuple[int, int]
    ours: Answer
    master: tuple[int, int]
    faults: tuple[str, ...]
    literal: Answer | None
    literal_limit_s: float

    @property
    def speed_up(self) -> float | None:
        """The literal model's CPU time over ours; None unless both came to an end.

        Both use one thread, so it is the ratio of the times on a machine that does nothing else.
        """
        if self.literal is None or not (self.literal.proven and self.ours.proven):
            return None
        assert self.literal.cpu_seconds is not None
        assert self.ours.cpu_seconds is not None
        return self.literal.cpu_seconds / self.ours.cpu_seconds

    @property
    def same(self) -> bool | None:
        """Whether both say the same, objective and status; None unless both came to an end."""
        if self.literal is None or not (self.literal.proven and self.ours.proven):
            return None
        theirs, ours = self.literal.objective, self.ours.objective
        if theirs is None or ours is None:
            return theirs is ours
        return abs(theirs - ours) <= _OBJECTIVE_TOLERANCE

    @property
    def as_the_paper(self) -> bool | None:
        """Proven, and infeasible just where the paper says so; None where it ran into its limit."""
        if not self.cell.within_limit:
            return None
        return self.ours.proven and (self.ours.status == "infeasible") == self.cell.infeasible


def measure_cells(
    instance: PaperInstance, cells: Sequence[Cell], out: Path, literal_limit_s: float, progress: Progress
) -> None:
    """Measure what OUT/cells does not hold yet. literal_limit_s: 0 leaves the literal model out."""
    todo = [cell for cell in cells if not _held(instance, cell, out, literal_limit_s)]
    progress("cells", len(cells) - len(todo), len(cells), "")
    if todo:
        (out / "cells").mkdir(parents=True, exist_ok=True)
        warm_up(instance)
    for number, cell in enumerate(todo, start=len(cells) - len(todo)):
        progress("cells", number, len(cells), cell.name)
        result = measure(instance, cell, literal_limit_s)
        document = {"instance": instance.digest, "result": asdict(result)}
        write_text(_file(out, cell), json.dumps(document, indent=1, allow_nan=False) + "\n")
        progress("cells", number + 1, len(cells), "")


def measure(instance: PaperInstance, cell: Cell, literal_limit_s: float) -> CellResult:
    """Ours and the literal model, one after the other."""
    problem = instance.problem(cell)
    tries = [_solve_ours(problem) for _ in range(REPEATS)]
    ours, master, faults = min(tries, key=lambda found: found[0].seconds)
    literal = solve_literal(problem, literal_limit_s) if literal_limit_s > 0.0 else None
    return CellResult(cell, instance.printed_size(cell), ours, master, faults, literal, literal_limit_s)


def load_results(instance: PaperInstance, out: Path) -> list[CellResult]:
    """What OUT/cells holds of this instance, in the paper's order."""
    loaded = (_load(instance, cell, out) for cell in CELLS)
    return [result for result in loaded if result is not None]


def warm_up(instance: PaperInstance) -> None:
    """Numba compiles, or reads what it has compiled, at the first call."""
    (cell,) = [cell for cell in CELLS if cell.name == _WARM_UP]
    decomposed.solve(instance.problem(cell), time_limit_s=_LIMIT_S)


def _solve_ours(problem: Problem) -> tuple[Answer, tuple[int, int], tuple[str, ...]]:
    begun_s, cpu_begun_s = time.perf_counter(), time.process_time()
    plan = decomposed.solve(problem, time_limit_s=_LIMIT_S)
    seconds, cpu_s = time.perf_counter() - begun_s, time.process_time() - cpu_begun_s
    answer = Answer(plan.status, plan.objective, plan.gap, seconds, cpu_s)
    return answer, (plan.variables, plan.constraints), tuple(validate(problem, plan))


def _held(instance: PaperInstance, cell: Cell, out: Path, literal_limit_s: float) -> bool:
    result = _load(instance, cell, out)
    if result is None:
        return False
    ended = result.literal is not None and result.literal.proven
    return ended or result.literal_limit_s >= literal_limit_s


def _load(instance: PaperInstance, cell: Cell, out: Path) -> CellResult | None:
    """The stored result; None if there is none, or one of another pool or inventory."""
    path = _file(out, cell)
    try:
        document = json.loads(path.read_bytes())
        if document["instance"] != instance.digest:
            return None
        return _result(cell, document["result"])
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        found = f"no result that can be read ({error})"
        raise InputError(path, found, "the file as it was written, or none") from None


def _result(cell: Cell, record: dict) -> CellResult:  # type: ignore[type-arg]
    literal = record["literal"]
    return CellResult(
        cell,
        tuple(record["size"]),
        Answer(**record["ours"]),
        tuple(record["master"]),
        tuple(record["faults"]),
        None if literal is None else Answer(**literal),
        record["literal_limit_s"],
    )


def _file(out: Path, cell: Cell) -> Path:
    return out / "cells" / f"{cell.name}.json"

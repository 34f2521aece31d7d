"""``searchlight allocate``: plan without a mission, and plan again."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from actors.terminal import say
from pipeline.errors import InputError, NoPlanError, NoPlanInTimeError

if TYPE_CHECKING:
    from pipeline.allocation.plan import Plan
    from pipeline.allocation.planned_again import PlannedAgain, Priorities
    from pipeline.allocation.problem import Problem


class Model(StrEnum):
    """literal: the paper's integer program. decomposed: the same optimum, a thousand times faster."""

    LITERAL = "literal"
    DECOMPOSED = "decomposed"


def allocate(
    problem: Annotated[Path, typer.Argument(help="The problem file (YAML).")],
    model: Annotated[Model, typer.Option(help="Which integer program.")] = Model.DECOMPOSED,
    time_limit: Annotated[
        float | None, typer.Option(min=0.001, help="Seconds; without it, the problem file's time_limit.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the plan as JSON.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for plan.json and schedule.png.")] = None,
    running: Annotated[
        Path | None, typer.Option(help="The plan.json that runs now: move as few substreams as possible.")
    ] = None,
    loss: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="With --running: share of accuracy to give up for that.")
    ] = 0.01,
) -> None:
    """Decide which detector looks at which frame of which stream, where, and at which bitrate.

    With --running, streams that cannot be served are left out and named, those of the lowest priority in the
    problem file first; the others are planned.
    """
    from pipeline.allocation.problem_file import problem_of
    from pipeline.config.problem import load_problem

    file = load_problem(problem)
    stated = problem_of(file, problem)
    limit_s = file.processing.time_limit if time_limit is None else time_limit
    if running is not None and model is Model.LITERAL:
        raise InputError("--model", "literal with --running", "decomposed: only it plans again")
    if running is None:
        plan = _solve(stated, model, limit_s)
    else:
        priorities = {name: stream.priority for stream in file.streams for name in stream.names}
        again = _again(stated, problem, running, priorities, loss, limit_s)
        stated, plan = again.problem, again.plan
    if plan.status == "infeasible":
        from pipeline.allocation.explain import explain

        raise NoPlanError(f"{problem}: no allocation satisfies it: {explain(stated).text}")
    if plan.status == "unknown":
        raise NoPlanInTimeError(f"{problem}: found no plan within {limit_s:g} s; expected more --time-limit")
    if out is not None:
        _write(stated, plan, out)
    _print(stated, plan, as_json)


def _solve(problem: Problem, model: Model, limit_s: float) -> Plan:
    from pipeline.allocation import decomposed, literal

    solve = literal.solve if model is Model.LITERAL else decomposed.solve
    return solve(problem, time_limit_s=limit_s)


def _again(
    problem: Problem, path: Path, running: Path, priorities: Priorities, loss: float, limit_s: float
) -> PlannedAgain:
    from pipeline.allocation.again import plan_again
    from pipeline.allocation.plan import plan_from_json

    try:
        text = running.read_text(encoding="utf-8")
    except (OSError, ValueError):
        raise InputError(running, "no readable file", "a plan.json of an earlier plan") from None
    assignments = plan_from_json(text, running).assignments
    found = plan_again(problem, assignments, priorities=priorities, loss=loss, time_limit_s=limit_s)
    if not found.problem.streams:
        reasons = "; ".join(f"stream {one.stream}: {one.reason}" for one in found.unserved)
        raise NoPlanError(f"{path}: no stream can be served: {reasons}")
    for line in found.text.splitlines():
        say(line)
    return found


def _write(problem: Problem, plan: Plan, out: Path) -> None:
    from pipeline.allocation.gantt import gantt_png
    from pipeline.allocation.plan import plan_to_json
    from pipeline.storage.whole_or_nothing import make_folder, write_bytes, write_text

    make_folder(out)
    write_bytes(out / "schedule.png", gantt_png(problem, plan))
    write_text(out / "plan.json", plan_to_json(plan, problem))
    say(f"wrote {out / 'plan.json'} and {out / 'schedule.png'}")


def _print(problem: Problem, plan: Plan, as_json: bool) -> None:
    from pipeline.allocation.plan import PLAN_COLUMNS, plan_table, plan_to_json

    if as_json:
        typer.echo(plan_to_json(plan, problem), nl=False)
        return
    table = Table(
        title=f"{plan.status}: objective {plan.objective:.6g}, bound {plan.bound:.6g}, gap {plan.gap:.2g}, "
        f"{plan.solve_s:.3f} s"
    )
    for column in PLAN_COLUMNS:
        table.add_column(column, no_wrap=True)
    for row in plan_table(plan):
        table.add_row(*row)
    Console().print(table)

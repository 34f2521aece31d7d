"""``searchlight experiment``: the paper's experiments on simulated missions with the shipped detectors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from actors.terminal import progress_bars, say
from pipeline.storage.whole_or_nothing import make_folder

app = typer.Typer(no_args_is_help=True, help="The paper's experiments, its figures beside ours.")

Out = Annotated[
    Path, typer.Option(help="Folder for missions, detections and the report; kept and used again.")
]
Mission = Annotated[Path, typer.Option(help="A mission file with truth.")]
_DEMO = Path("configs/missions/demo/mission.yaml")


@app.command("1")
def detector_accuracy(out: Out, mission: Mission = _DEMO) -> None:
    """The detector's relative accuracy, 0.98 against half of it."""
    from pipeline.experiments.detector_accuracy import detector_accuracy as experiment

    _run(experiment, mission, out)


@app.command("2")
def moving_person(
    out: Out,
    scenario: Annotated[Path, typer.Option(help="A scenario with a drone that hovers.")] = Path(
        "configs/scenarios/hover.yaml"
    ),
) -> None:
    """A person walks past a hovering drone: the trail with p_negative_max 0.05 and 0.5."""
    from pipeline.experiments.moving_person import moving_person as experiment

    _run(experiment, scenario, out)


@app.command("3")
def cell_sizes(out: Out, mission: Mission = _DEMO) -> None:
    """Position error with cells of 1, 0.5 and 0.25 m."""
    from pipeline.experiments.cell_sizes import cell_sizes as experiment

    _run(experiment, mission, out)


@app.command("4")
def pose_errors(out: Out, mission: Mission = _DEMO) -> None:
    """The same with the pose errors of a real flight."""
    from pipeline.experiments.cell_sizes import cell_sizes_with_pose_errors as experiment

    _run(experiment, mission, out)


@app.command("5")
def allocations(
    out: Out,
    mission: Mission = _DEMO,
    pool: Annotated[Path, typer.Option(help="The pool of our detectors.")] = Path(
        "configs/pools/simulated.yaml"
    ),
    papers_pool: Annotated[Path, typer.Option(help="The paper's networks and their times.")] = Path(
        "configs/pools/paper.yaml"
    ),
) -> None:
    """Three allocations on the paper's machines, through the channels of a run: 5, 9, 9 of 9 in the paper."""
    from actors.commands.run import run_case
    from pipeline.experiments.allocations import allocations_found, write_cases

    make_folder(out)
    cases = write_cases(mission, papers_pool, pool, out)
    for file in cases.values():
        run_case(file, file.parent / "run")
    _report(out, allocations_found({name: file.parent / "run" for name, file in cases.items()}))


def _run(experiment: Callable[..., object], source: Path, out: Path) -> None:
    make_folder(out)
    with progress_bars("steps") as progress:
        found = experiment(source, out, progress)
    _report(out, found)


def _report(out: Path, found) -> None:  # type: ignore[no-untyped-def]
    from pipeline.experiments.experiment_report import write_experiment

    write_experiment(out, found)
    _print(found)
    say(f"see {out / 'report.html'}")


def _print(found) -> None:  # type: ignore[no-untyped-def]
    table = Table(title=f"Experiment {found.number}: {found.title}")
    for column in ("", "here", "the paper", "asked", ""):
        table.add_column(column)
    for m in found.measures:
        asked = "" if m.wanted is None else f"{m.wanted} {m.limit:g}"
        met = "" if m.met is None else "reached" if m.met else "not reached"
        table.add_row(m.name, f"{m.ours:.3g} {m.unit}", m.paper, asked, met)
    Console().print(table)

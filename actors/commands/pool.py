"""``searchlight pool``: look at pools, merge them, compare them, carry them over to other machines."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from actors.commands.tables import print_table
from pipeline.errors import InputError

app = typer.Typer(
    no_args_is_help=True, help="Look at pools of detectors, merge them, compare them, carry them over."
)


@app.command()
def show(pool: Annotated[Path, typer.Argument(help="The pool file (YAML).")]) -> None:
    """Each detector with its accuracy and its costs."""
    from pipeline.config.pool import load_pool
    from pipeline.evaluation.pool.pool_tools import shown

    loaded = load_pool(pool)
    print_table(shown(loaded))
    typer.echo()
    for name, value in loaded.provenance.items():
        typer.echo(f"{name}: {value}")


@app.command()
def merge(
    pools: Annotated[
        list[Path], typer.Argument(help="Pool files; one alone is copied, and its paths follow.")
    ],
    out: Annotated[Path, typer.Option(help="The pool file to write; must not exist.")],
) -> None:
    """One pool of several: other detectors, or the same ones on other machines."""
    from pipeline.evaluation.pool.pool_tools import merge as merge_pools

    _require_new(out)
    merge_pools(pools, out)


@app.command()
def assume(
    pool: Annotated[Path, typer.Argument(help="A pool file.")],
    out: Annotated[Path, typer.Option(help="The pool file to write; must not exist.")],
    machine: Annotated[str, typer.Option(help="The machine type that could not be measured.")],
    like: Annotated[str, typer.Option(help="A machine type that was.")],
    slower: Annotated[float, typer.Option(min=0.01, max=1e4, help="How many times as slow it is.")],
    detector: Annotated[list[str] | None, typer.Option(help="Keep this one only; may be repeated.")] = None,
) -> None:
    """A pool for a machine that was not measured, and that says so."""
    from pipeline.evaluation.pool.pool_tools import assume as assume_machine

    _require_new(out)
    assume_machine(pool, out, machine=machine, like=like, slower=slower, detectors=tuple(detector or ()))


@app.command("operating-points")
def operating_points(
    pool: Annotated[Path, typer.Argument(help="A pool file.")],
    evaluation: Annotated[
        Path, typer.Argument(help="The folder of an evaluation of its detectors, at its thresholds.")
    ],
    out: Annotated[Path, typer.Option(help="The pool file to write; must not exist.")],
) -> None:
    """The pool with what its detectors' boxes are worth at each codec and bitrate, as an evaluation found."""
    from pipeline.evaluation.pool.operating_points_into import put_operating_points

    _require_new(out)
    put_operating_points(pool, evaluation / "results.json", out)


def _require_new(out: Path) -> None:
    if out.exists():
        raise InputError(out, "a file that is there already", "a new name")
    if not out.parent.is_dir():
        raise InputError(out.parent, "no folder", "a folder that exists")


@app.command()
def diff(
    old: Annotated[Path, typer.Argument(help="A pool file.")],
    new: Annotated[Path, typer.Argument(help="Another one.")],
) -> None:
    """What is different; exit code 1 if anything is."""
    from pipeline.config.pool import load_pool
    from pipeline.evaluation.pool.pool_tools import differences

    rows = list(differences(load_pool(old), load_pool(new)))
    if rows:
        print_table([("detector", "field", "old", "new"), *rows], left=2)
        raise typer.Exit(1)


def register(application: Any) -> None:
    """Add the sub-commands to the application."""
    application.add_typer(app, name="pool")

"""Find people in the video of search drones, and say where they are."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import Annotated

import typer

from actors.commands import (
    allocate,
    detector,
    evaluate,
    experiment,
    experiment_allocation,
    export,
    fuse,
    init,
    mission,
    pool,
    status,
)
from actors.terminal import progress_bars as _progress
from actors.terminal import say as _say
from pipeline.errors import InputError, SearchlightError

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, help=__doc__)
app.command()(allocate.allocate)
app.command()(export.export)
app.command()(fuse.fuse)
app.command()(init.init)
app.command()(status.status)
experiment_allocation.register(experiment.app)
app.add_typer(experiment.app, name="experiment")
evaluate.register(app)
pool.register(app)
mission.register(app)
detector.register(app)


def _print_version(asked: bool) -> None:
    if asked:
        print(f"searchlight {installed_version('searchlight')}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version.")
    ] = False,
) -> None:
    """Find people in the video of search drones, and say where they are."""


class Pace(StrEnum):
    """realtime: as the video plays. max: as fast as this machine can."""

    REALTIME = "realtime"
    MAX = "max"


@app.command()
def simulate(
    scenario: Annotated[Path, typer.Argument(help="The scenario file (YAML).")],
    out: Annotated[Path, typer.Option(help="Folder for the mission; must not exist or be empty.")],
) -> None:
    """Render a mission in the formats that a real one has."""
    from pipeline.simulation.mission_writer import simulate as write_mission

    with _progress("frames") as progress:
        mission = write_mission(scenario, out, progress=progress)
    _say(f"wrote {mission}")


@app.command()
def check(
    mission: Annotated[
        Path | None, typer.Argument(help="The mission file (YAML), or its folder; absent: the only one here.")
    ] = None,
    address: Annotated[
        str | None, typer.Option(help="A running Ray cluster: files are looked at on its nodes.")
    ] = None,
) -> None:
    """Find everything that would keep a mission from running, without running it."""
    from actors.commands.check import check_mission

    check_mission(mission, address)


@app.command()
def run(
    mission: Annotated[
        Path | None, typer.Argument(help="The mission file (YAML), or its folder; absent: the only one here.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Run directory; new, empty, or of an earlier run. Absent: run, beside the mission."
        ),
    ] = None,
    pace: Annotated[
        Pace, typer.Option(help="As the video plays, or as fast as this machine can.")
    ] = Pace.MAX,
    local: Annotated[
        bool, typer.Option("--local", help="In one process, without Ray: the reference.")
    ] = False,
    address: Annotated[
        str | None, typer.Option(help="A running Ray cluster; without it one is started.")
    ] = None,
    metrics_port: Annotated[
        int | None, typer.Option(help="Serve /metrics there; 0 for any free port.")
    ] = None,
    metrics_host: Annotated[str, typer.Option(help="Interface for /metrics.")] = "127.0.0.1",
    onto: Annotated[
        Path | None,
        typer.Option(help="Run directory of an earlier flight: its map goes on with this one, in --out."),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(help="Run directory of a run that was cut off: goes on with it, in the same directory."),
    ] = None,
    checkpoint_every: Annotated[
        float, typer.Option(min=0.0, help="Seconds between checkpoints, which make resuming quicker.")
    ] = 60.0,
) -> None:
    """Detect, fuse and map: from video files to the people found."""
    from actors.commands.run import RunRequest, run_mission

    request = RunRequest(
        mission,
        out,
        pace.value,
        local,
        address,
        metrics_port,
        metrics_host,
        onto,
        resume,
        checkpoint_every,
    )
    code = run_mission(request)
    if code:
        raise typer.Exit(code)


@app.command()
def view(
    run: Annotated[Path, typer.Argument(help="Run directory, of a run that is finished or that flies.")],
    port: Annotated[int, typer.Option(help="0 for any free port.")] = 8750,
    host: Annotated[
        str, typer.Option(help="Interface; anything but loopback asks for the token that is printed.")
    ] = "127.0.0.1",
    export_coco: Annotated[
        Path | None,
        typer.Option(
            help="Show nothing; write the pictures of confirmed and rejected places there, as COCO."
        ),
    ] = None,
) -> None:
    """Show a run in a browser, without internet: the map as it grows, and what reviewers decide."""
    from actors.commands.view import export_decided, view_run

    if export_coco is not None:
        export_decided(run, export_coco)
    else:
        view_run(run, host, port)


@app.command("simulate-load")
def simulate_load(
    streams: Annotated[int, typer.Option(min=4, help="Of 10 Hz.")] = 100,
    sites: Annotated[int, typer.Option(min=1, help="That look at them.")] = 10,
    limit: Annotated[float, typer.Option(min=1.0, help="Seconds of processor for each size.")] = 60.0,
) -> None:
    """How many streams the ground station bears: the real controller and reducer in virtual time, as they cost here."""
    from actors.commands.simulate_load import simulate_load as simulate

    simulate(streams, sites, limit)


@app.command("node-metrics")
def node_metrics(
    port: Annotated[int, typer.Option(help="0 for any free port.")] = 9401,
    host: Annotated[str, typer.Option(help="Interface.")] = "127.0.0.1",
) -> None:
    """Serve Prometheus metrics of this node: memory, processor, actors that run on it, its clock."""
    from actors.commands.node import serve_node

    serve_node(port, host)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Run directory; new, empty, or of an earlier run.")],
    local: Annotated[bool, typer.Option("--local", help="In one process, without Ray.")] = False,
) -> None:
    """Run the demo that comes with Searchlight: two drones over simulated country."""
    from pipeline.config.shipped import shipped

    run(shipped("missions", "demo", "mission.yaml"), out, local=local)


@app.command()
def train(
    config: Annotated[Path, typer.Argument(help="The training configuration (YAML).")],
    out: Annotated[Path, typer.Option(help="Folder for data, checkpoints and the ONNX file.")],
    leave_one_out: Annotated[
        bool,
        typer.Option(
            "--leave-one-out", help="Train without each flight in turn and print what it finds there."
        ),
    ] = False,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Of each training of --leave-one-out: a shorter schedule.")
    ] = None,
) -> None:
    """Train a person detector on simulated scenes or labelled pictures (needs the extra 'train')."""
    if steps is not None and not leave_one_out:
        raise InputError(
            "--steps", str(steps), "--leave-one-out beside it; a training's steps are in its file"
        )
    with _needs_training():
        if leave_one_out:
            from actors.commands.leave_one_out import print_folds

            print_folds(config, out, steps)
            return
        from pipeline.training.train import train as train_detector

        with _progress("steps") as progress:
            train_detector(config, out, progress=progress)


@contextmanager
def _needs_training() -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        expected = "pip install 'searchlight[train]'"
        raise InputError("the extra 'train'", f"no module {error.name}", expected) from None


def main() -> None:
    """Run the command line; an error of ours is one line and exit code 2."""
    try:
        app()
    except SearchlightError as error:
        for line in str(error).splitlines():
            _say(f"error: {line}")
        if error.details:
            _say(error.details)
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()

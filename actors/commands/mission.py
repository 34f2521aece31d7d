"""``searchlight mission``: what an operator may ask of a mission that flies."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from actors.terminal import say
from pipeline.mission.operator import What, ask

_Run = Annotated[Path, typer.Argument(help="The run directory of a `run --pace realtime` that goes on.")]
_Stream = Annotated[str, typer.Argument(help="The stream's name in the mission file.")]

app = typer.Typer(
    no_args_is_help=True,
    help="Pause, resume, stop or revoke streams of a mission while it flies, or change its area.",
)


@app.command()
def pause(run: _Run, stream: _Stream) -> None:
    """Look at a stream no more; its links and machines serve the others."""
    _ask(run, "pause", stream)


@app.command()
def resume(run: _Run, stream: _Stream) -> None:
    """Look at a paused stream again."""
    _ask(run, "resume", stream)


@app.command()
def stop(
    run: _Run, stream: Annotated[str | None, typer.Argument(help="Absent: all of them.")] = None
) -> None:
    """End a stream, or the whole mission: what was sent is still looked at, then the map is published."""
    _ask(run, "stop", stream)


@app.command()
def revoke(run: _Run, stream: _Stream) -> None:
    """A drone is lost: accept its key no more, whoever has it now; what came before stays in the map."""
    _ask(run, "revoke", stream)


@app.command()
def area(
    run: _Run, file: Annotated[Path, typer.Argument(help="GeoJSON, KML or KMZ with the new search area.")]
) -> None:
    """Search another area: coverage, verdict and second look are judged by it; the map so far stays."""
    say(ask(run, "area", None, file=file))


def _ask(run: Path, what: What, stream: str | None) -> None:
    say(ask(run, what, stream))


def register(application: Any) -> None:
    """Add the sub-commands to the application."""
    application.add_typer(app, name="mission")

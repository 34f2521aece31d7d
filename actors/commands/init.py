"""``searchlight init``: begin with a folder of files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from actors.terminal import progress_bars, say


def init(
    folder: Annotated[Path, typer.Argument(help="Video, telemetry and surface model, in any order.")],
) -> None:
    """Write a mission from what lies in a folder, and say what was assumed and what is missing."""
    from pipeline.init.init_mission import init_mission

    with progress_bars(None) as progress:
        result = init_mission(folder, progress)
    for path, reason in result.unused.items():
        say(f"not used: {path}: {reason}")
    streams = "1 stream" if result.streams == 1 else f"{result.streams} streams"
    say(f"wrote {result.mission} with {streams}, inventory.yaml and pool.yaml beside it")
    for line in result.to_fill:
        say(f"to fill in, {line}")
    then = "fill these in, then" if result.to_fill else "next:"
    say(f"{then} searchlight check {result.mission} and searchlight run {result.mission}")

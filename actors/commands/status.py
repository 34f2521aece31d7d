"""``searchlight status``: where a run stands."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from pipeline.mission.status import run_status


def status(
    run: Annotated[
        Path, typer.Argument(help="Run directory, of a run that flies, was cut off, or has ended.")
    ],
    as_json: Annotated[
        bool, typer.Option("--json", help="What the run's files say, as one JSON object.")
    ] = False,
) -> None:
    """Where a run stands: found so far, frames, links, machines, and what happened last. Changes nothing."""
    found = run_status(run, datetime.now(UTC))
    if as_json:
        print(json.dumps({"state": found.state} | dict(found.said)))
    else:
        print(*found.lines, sep="\n")

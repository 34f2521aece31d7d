"""``searchlight evaluate``, ``searchlight score`` and ``searchlight convert-annotations``."""

from __future__ import annotations

import json
import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from actors.commands.tables import print_table
from actors.terminal import progress_bars, say
from pipeline.errors import InputError, SearchlightError


class InterruptedRunError(SearchlightError):
    """The user pressed Ctrl-C; what was finished is kept."""

    exit_code = 130


class AnnotationFormat(StrEnum):
    """Data sets that can be converted to COCO JSON."""

    MOT = "mot"
    VISDRONE = "visdrone"


def evaluate(
    evaluation: Annotated[Path, typer.Argument(help="The evaluation file (YAML).")],
    out: Annotated[
        Path, typer.Option(help="Folder; new, empty, or of an earlier evaluation, which goes on.")
    ],
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; by default one for each core.")
    ] = None,
    address: Annotated[
        str | None,
        typer.Option(help="A running Ray cluster to share the work with; the files must be there too."),
    ] = None,
) -> None:
    """Measure detectors under codecs, bitrates and setups; write a pool and a report."""
    from pipeline.evaluation.measuring.grid import in_processes
    from pipeline.evaluation.run import evaluate as run

    workers = workers or os.cpu_count() or 1
    execute = in_processes(workers)
    if address is not None:
        from actors.evaluation_cluster import on_cluster

        execute = on_cluster(address)
    try:
        # shares: a cell of H.265 takes many times as long as one of H.264
        with progress_bars(None) as progress:
            finished = run(evaluation, out, execute=execute, progress=progress, say=say, workers=workers)
    except KeyboardInterrupt:
        raise InterruptedRunError(
            f"interrupted; the same command goes on with what is in {out / 'cache'}"
        ) from None
    say(f"see {finished.report}")
    say("no pool: it needs timing" if finished.pool is None else f"pool: {finished.pool}")


def score(
    truth: Annotated[Path, typer.Argument(help="Truth, COCO JSON.")],
    results: Annotated[Path, typer.Argument(help="Detections, COCO's list of results (JSON).")],
) -> None:
    """AP, AR and LRP of detections that are there already."""
    from pipeline.evaluation.metrics.score import score_files

    scored = score_files(truth, results)
    for line in scored.faults:
        say(line)
    print_table(scored.classes)
    typer.echo()
    print_table(scored.sizes)


def convert_annotations(
    kind: Annotated[AnnotationFormat, typer.Argument(help="What the folder holds.")],
    folder: Annotated[Path, typer.Argument(help="The data set's folder.")],
    out: Annotated[Path, typer.Option(help="The COCO JSON file to write.")],
) -> None:
    """MOT or VisDrone annotations to COCO JSON; file names are relative to the folder."""
    from pipeline.config.evaluation import FaultPolicy
    from pipeline.evaluation.datasets.converters import converted
    from pipeline.evaluation.datasets.fault_log import FaultLog
    from pipeline.storage.whole_or_nothing import write_text

    document = converted(kind.value, folder, FaultLog(FaultPolicy()))
    try:
        write_text(out, json.dumps(document))
    except OSError as error:
        raise InputError(
            out, f"no place to write ({error.strerror})", "a file in a folder that exists"
        ) from None
    say(f"wrote {out}: {len(document['images'])} pictures, {len(document['annotations'])} boxes")


def register(app: Any) -> None:
    """Add the commands to the application."""
    app.command()(evaluate)
    app.command()(score)
    app.command()(convert_annotations)

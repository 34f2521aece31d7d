"""``searchlight export``: a run in the formats of the tools that a team uses."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from actors.terminal import say


def export(
    run: Annotated[Path, typer.Argument(help="The directory of a finished run.")],
    to: Annotated[
        str,
        typer.Option(
            help="geojson, kml, kmz, gpx, csv, cog, gpkg, caltopo, cot, pdf; several with commas; all."
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the files. Absent: exports, in the run's.")
    ] = None,
    redact: Annotated[
        bool,
        typer.Option(
            "--redact", help="Blur pictures, round positions to 0.01 degrees, leave out ways and names."
        ),
    ] = False,
) -> None:
    """Hand a run over: places, ways and the map in other tools' formats."""
    from pipeline.outputs.exports.redaction import redacted
    from pipeline.outputs.exports.registry import FORMATS, formats_of, write_exports
    from pipeline.outputs.exports.view import EXPORTS, read_run
    from pipeline.storage.whole_or_nothing import add_to_run

    formats = formats_of(to)
    view = read_run(run, datetime.now(UTC))
    if redact:
        if to.strip().lower() == "all":
            formats = tuple(name for name in formats if not FORMATS[name].exact)
        view = redacted(view)
    folder = out or run / (f"{EXPORTS}-redacted" if redact else EXPORTS)
    for sentence in view.absent:
        say(f"note: {sentence}: what would be of it is left out")
    names = write_exports(folder, view, formats)
    if out is None:
        add_to_run(run, [f"{folder.name}/{name}" for name in names])
    for name in names:
        say(f"wrote {folder / name}")
    if view.redacted:
        say(view.redacted)

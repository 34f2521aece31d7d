"""``searchlight export``: a run in the formats of the tools that a team uses."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from actors.terminal import say
from pipeline.errors import InputError, RunFailedError


def export(
    run: Annotated[
        Path, typer.Argument(help="The directory of a finished run; with --watch, of one that flies.")
    ],
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
    send: Annotated[
        str | None,
        typer.Option(help="Send the places as Cursor on Target: tcp://HOST:PORT, tls://.. or udp://..."),
    ] = None,
    give_up_after: Annotated[
        float, typer.Option(min=0.0, help="Seconds that events wait for --send when all else is done.")
    ] = 60.0,
    watch: Annotated[
        bool,
        typer.Option(
            "--watch", help="Follow a run while it flies: hand over whatever changes, until its end."
        ),
    ] = False,
) -> None:
    """Hand a run over: places, ways and the map in other tools' formats."""
    from actors.cot_sender import CotSender
    from actors.export_watch import Follower, Wanted, with_sender
    from pipeline.outputs.exports.cot import events_of
    from pipeline.outputs.exports.redaction import redacted
    from pipeline.outputs.exports.registry import FORMATS, formats_of, write_exports
    from pipeline.outputs.exports.view import EXPORTS, RunView, read_run
    from pipeline.storage.whole_or_nothing import add_to_run
    from pipeline.view.decided_run import with_decided

    formats = formats_of(to)
    if redact and to.strip().lower() == "all":
        formats = tuple(name for name in formats if not FORMATS[name].exact)
    if send is not None and "cot" not in formats:
        raise InputError("--send", f"--to {to}", "cot among the formats: what is sent are its events")
    folder = out or run / (f"{EXPORTS}-redacted" if redact else EXPORTS)

    told = set[str]()

    def change(view: RunView) -> RunView:
        view, lost = with_decided(view, run)
        for sentence in lost:
            if sentence not in told:
                say(f"note: {sentence}")
        told.update(lost)
        return redacted(view) if redact else view

    async def once(sender: CotSender | None) -> RunView:
        view = change(read_run(run, datetime.now(UTC)))
        for sentence in view.absent:
            say(f"note: {sentence}: what would be of it is left out")
        for name in write_exports(folder, view, formats):
            say(f"wrote {folder / name}")
        if view.redacted:
            say(view.redacted)
        if sender is not None:
            sender.put(events_of(view))
        return view

    async def all_of_it() -> bool:
        sender = None if send is None else CotSender(send, say)
        follower = Follower(Wanted(run, folder, formats, change), sender, say)
        work = asyncio.ensure_future(follower.follow() if watch else once(sender))
        done = await with_sender(sender, work, give_up_after)
        if sender is not None:
            say(f"sent {sender.sent} events to {send}")
            if not done:
                raise RunFailedError(
                    f"{send}: {sender.waiting} events could not be sent within {give_up_after:g} s"
                )
        return done

    asyncio.run(all_of_it())
    if out is None:
        files = [path for path in folder.rglob("*") if path.is_file()]
        add_to_run(run, [path.relative_to(run).as_posix() for path in files])

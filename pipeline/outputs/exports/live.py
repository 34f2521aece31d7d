"""A run that still flies, as far as the files in ``live/`` of its directory say."""

from __future__ import annotations

import json
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from pipeline.outputs.exports.view import Kind, RunView, features_of, places_of
from pipeline.outputs.live_names import FOUND, LIVE, POSSIBLE, REDUCER, STATUS


def live_state(run: Path) -> tuple[int, int] | None:
    """Another value whenever the places were written again; the found ones come last. None where no run flies."""
    try:
        state = (run / LIVE / FOUND).stat()
    except OSError:
        return None
    return state.st_mtime_ns, state.st_ino


def read_live(run: Path, made_at: datetime) -> RunView | None:
    """The run so far: places without pictures, ways or map; None where no run flies, or no longer.

    Raises InputError for places that cannot be used.
    """
    folder = run / LIVE
    kinds: tuple[tuple[Kind, str], ...] = (("possible", POSSIBLE), ("found", FOUND))
    if not (folder / FOUND).is_file():
        return None
    places = [
        (kind, folder / name, feature)
        for kind, name in kinds
        if (folder / name).is_file()
        for feature in features_of(folder / name, "places")
    ]
    mission = str(_said(folder / STATUS).get("mission") or run.absolute().name)
    verdict = _said(folder / REDUCER).get("verdict")
    sentence = str(verdict.get("sentence", "")) if isinstance(verdict, dict) else ""
    said = f"THE MISSION STILL FLIES. {sentence}".strip()
    return RunView(mission, said, made_at, places_of(places, folder), (), (), (), None, None)


def _said(path: Path) -> dict[str, Any]:
    with suppress(OSError, ValueError):
        document = json.loads(path.read_bytes())
        if isinstance(document, dict):
            return document
    return {}

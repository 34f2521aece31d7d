"""Which mission file is meant."""

from __future__ import annotations

from pathlib import Path

from pipeline.errors import InputError

NAME = "mission.yaml"


def find_mission(given: Path | None, here: Path = Path()) -> Path:
    """The file given; the mission of the folder given; or, with nothing given, the only one here or a folder below.

    Raises InputError if there is none, or more than one.
    """
    if given is not None:
        return given / NAME if given.is_dir() else given
    if (here / NAME).is_file():
        return here / NAME
    found = sorted(here.glob(f"*/{NAME}"))
    if len(found) == 1:
        return found[0]
    what = f"{len(found)} missions: {', '.join(map(str, found[:5]))}" if found else "no mission"
    raise InputError(here.resolve(), what, f"the name of one, or searchlight init FOLDER to make a {NAME}")

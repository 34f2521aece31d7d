"""The files of a run that are there to be looked at: while it flies in ``live/`` of its directory, later beside it.

Each appears whole or not at all, so that a reader never sees half of one.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pipeline.errors import InputError
from pipeline.outputs.live_names import LIVE
from pipeline.storage.whole_or_nothing import SUMMARY_FILE, UNFINISHED

GROUND, POSES, SIGHTINGS = "ground.npz", "poses.npz", "sightings.json"
#: only in ``live/``: the map so far
MAP = "map.npz"

State = Literal["flying", "finished"]


@dataclass(frozen=True)
class RunFolder:
    """run: the directory. state: flying (or cut off before its map was written), or finished."""

    run: Path
    state: State

    @property
    def folder(self) -> Path:
        """Where the files are now."""
        return self.run / LIVE if self.state == "flying" else self.run

    def read(self, name: str) -> bytes | None:
        """A file; None if there is none (yet, or since an earlier version wrote the run)."""
        try:
            return (self.folder / name).read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None


def find_run(run: Path) -> RunFolder:
    """What a directory holds now; ask again, for a run that flies will be finished. Raises InputError if no run."""
    if (run / UNFINISHED).is_file() and (run / LIVE).is_dir():
        return RunFolder(run, "flying")
    if (run / SUMMARY_FILE).is_file():
        return RunFolder(run, "finished")
    found = "no run: neither summary.json nor live/" if run.is_dir() else "no such directory"
    raise InputError(run, found, "the directory of a run, finished or flying (the --out of searchlight run)")

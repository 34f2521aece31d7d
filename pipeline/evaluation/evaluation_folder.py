"""The folder of an evaluation: ours from the first moment on, and one evaluation's at a time."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import InputError

#: marks the folder, so that an interrupted evaluation can go on in it
MARK = "evaluation.json"
CACHE = "cache"
_WRITTEN_BY = "searchlight evaluate"


def check_evaluation_directory(out: Path) -> None:
    """Raise InputError unless an evaluation may write here: absent, empty, or of an earlier evaluation."""
    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    try:
        ours = json.loads((out / MARK).read_bytes())["written_by"] == _WRITTEN_BY
    except (OSError, ValueError, KeyError, TypeError):
        ours = False
    if not ours:
        found = "a folder with other files" if out.is_dir() else "a file"
        raise InputError(out, found, "a new or empty folder, or that of an earlier evaluation")


@contextmanager
def evaluation_directory(out: Path) -> Iterator[None]:
    """Within it the folder is there and ours alone; what an interrupted run left half written is gone.

    Raises InputError if it cannot be made, and while another evaluation works in it.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        mark = (out / MARK).open("a+", encoding="utf-8")
    except OSError as error:
        raise InputError(out, f"no place to write ({error.strerror})", "a folder that can be made") from None
    with mark:
        try:
            fcntl.flock(mark, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(out, "another evaluation at work in it", "another folder, or to wait") from None
        if not mark.tell():
            mark.write(json.dumps({"written_by": _WRITTEN_BY}))
            mark.flush()
        for half in (out / CACHE).rglob(".*.part"):
            half.unlink(missing_ok=True)
        yield

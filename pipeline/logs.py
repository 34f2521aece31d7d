"""One structured logger per room: quiet, until a run gives all of them a file.

Every line is one JSON object: ``time`` (ISO 8601, UTC), ``room``, ``level``, ``event`` and the event's own fields. A
room logs a change of its state, with what it was changed by; it never logs and goes on where it should raise. Actors
in other processes log to files of their own in the folder that the environment names, see ``log_of_actor``.
"""

from __future__ import annotations

import faulthandler
import glob
import json
import logging
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from uuid import uuid4

from pipeline.errors import InputError, StoppedError
from pipeline.leftovers import swept

#: set by a run on Ray for the processes that it starts: the folder for their logs
FOLDER_VARIABLE = "SEARCHLIGHT_ACTOR_LOGS"
#: that folder, within a run directory
ACTOR_LOGS = "logs"
#: the file of a run directory that holds the log of its run
LOG_FILE = "run.log"
_ROOT = logging.getLogger("searchlight")
_ROOT.addHandler(logging.NullHandler())
_ROOT.propagate = False
_ROOT.setLevel(logging.INFO)


class Log:
    """The logger of one room."""

    def __init__(self, room: str) -> None:
        self._room, self._logger = room, _ROOT.getChild(room)

    def event(self, event: str, **fields: object) -> None:
        """A change of state. fields: whatever JSON can say; the rest as text."""
        self._logger.info(event, extra={"room": self._room, "fields": fields})

    def warning(self, event: str, **fields: object) -> None:
        """The same of what somebody should look at."""
        self._logger.warning(event, extra={"room": self._room, "fields": fields})


class _JsonLines(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        head = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "room": record.__dict__.get("room", record.name),
            "level": record.levelname.lower(),
            "event": record.getMessage(),
        }
        return json.dumps(head | record.__dict__.get("fields", {}), ensure_ascii=False, default=_as_text)


def _as_text(value: object) -> str:
    """What JSON cannot say. Of bytes and arrays, which may be pictures of people, only how many."""
    if isinstance(value, bytes | bytearray | memoryview):
        return f"<{memoryview(value).nbytes} bytes>"
    shape = getattr(value, "shape", None)
    return str(value) if shape is None else f"<{type(value).__name__} {shape}>"


class _RunFile(logging.FileHandler):
    """The file of the run that is going on."""


@contextmanager
def logged_run(out: Path) -> Iterator[None]:
    """Within it all rooms log to a file beside the run directory ``out``, for ``keep_log`` to take.

    If the block raises, the file is kept beside the directory as ``NAME.failed-run.log``, the error in its last line;
    else it is gone afterwards, and so is one that an earlier failure left. Input that is refused leaves nothing: the
    refusal says it all.
    """
    absolute = out.absolute()
    absolute.parent.mkdir(parents=True, exist_ok=True)
    temporary, kept = (
        absolute.with_name(f".{absolute.name}.{uuid4().hex}.log.part"),
        absolute.with_name(f"{absolute.name}.failed-run.log"),
    )
    _take_over(temporary, absolute)
    handler: _RunFile | None = None
    try:
        # within, so that a signal at this very moment leaves no file
        handler = _RunFile(temporary, encoding="utf-8")
        handler.setFormatter(_JsonLines())
        _ROOT.addHandler(handler)
        with swept(temporary):
            yield
        kept.unlink(missing_ok=True)
    except (InputError, StoppedError):
        raise
    except BaseException as error:
        Log("mission").warning("run failed", error=f"{type(error).__name__}: {error}")
        if handler is not None:
            handler.flush()
            temporary.replace(kept)
        raise
    finally:
        if handler is not None:
            _ROOT.removeHandler(handler)
            handler.close()
        temporary.unlink(missing_ok=True)


def log_of_actor(name: str) -> None:
    """Let this process, an actor of a run, log to its own file, ``NAME.log``, in the run directory.

    Nothing, where no folder is named, or it is not there: on another node than the run's. Also written there: the stack
    of a process that a library ends.
    """
    folder = Path(os.environ.get(FOLDER_VARIABLE, ""))
    if FOLDER_VARIABLE not in os.environ or not folder.is_dir():
        return
    handler = logging.FileHandler(folder / f"{re.sub(r'[^A-Za-z0-9._-]', '-', name)}.log", encoding="utf-8")
    handler.setFormatter(_JsonLines())
    _ROOT.addHandler(handler)
    if handler.stream is not None:
        faulthandler.enable(handler.stream)
    Log("actors").event("actor begins", actor=name, process=os.getpid())


def _take_over(log: Path, out: Path) -> None:
    """Begin a log with what a run of the same directory left that was killed; the directory is ours alone now."""
    for left in sorted(
        out.parent.glob(f".{glob.escape(out.name)}.*.log.part"), key=lambda p: p.stat().st_mtime
    ):
        with left.open("rb") as old, log.open("ab") as new:
            shutil.copyfileobj(old, new)
        left.unlink()


def keep_log(path: Path) -> None:
    """Copy what the run that is going on has logged so far; nothing, if nobody logs."""
    for handler in _ROOT.handlers:
        if isinstance(handler, _RunFile):
            handler.flush()
            shutil.copyfile(handler.baseFilename, path)

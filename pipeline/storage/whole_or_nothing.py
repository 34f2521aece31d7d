"""Files and folders that appear whole or not at all."""

from __future__ import annotations

import errno
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from pipeline.errors import InputError

#: the file that marks a folder as one of our run directories, and the value of its key ``written_by``
SUMMARY_FILE = "summary.json"
#: the names of all files of a run, one a line: what a later run may remove
FILE_LIST = ".run-files"
#: what earlier versions wrote, that kept no list
_UNLISTED = (
    *(
        "salient.geojson",
        "second_look.geojson",
        "second_flight.geojson",
        "second_flight.plan",
        "saliency*.tif",
    ),
    *("plan.json", "map.png", "schedule.png", "report.html"),
)
WRITTEN_BY = "searchlight run"
#: the file, within a run directory, of a run that goes on or was cut off
UNFINISHED = "journal/run.json"
#: a disk with less than this is full
_LEAST_FREE_BYTES = 65_536


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name beside path; on leaving, the file written there becomes path in one step.

    If the block raises, the temporary file is removed and path stays as it was.
    """
    temporary = _beside(path)
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """Write a file in UTF-8 whole or not at all."""
    write_bytes(path, text.encode("utf-8"))


def make_folder(path: Path) -> None:
    """Make a folder that may exist, with those above it. Raises InputError where that cannot be."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(path, f"no place to write ({error.strerror})", "a folder that can be made") from None


def check_run_directory(path: Path) -> None:
    """Raise InputError unless a run may write here: absent, empty, or the directory of a run, finished or not."""
    try:
        usable = not path.exists() or (path.is_dir() and (_is_empty(path) or _is_ours(path)))
    except OSError as error:
        raise InputError(path, f"a folder that cannot be read ({error.strerror})", "a folder") from None
    if not usable:
        found = "a folder with other files" if path.is_dir() else "a file"
        raise InputError(path, found, "a new or empty folder, or one that an earlier run has written")
    _require_writable(path)


def _require_writable(path: Path) -> None:
    """Raises InputError unless a folder can be made beside path: better known before a run than after it."""
    nearest = next(folder for folder in path.absolute().parents if folder.exists())
    for folder in (nearest, path) if path.exists() else (nearest,):
        try:
            os.rmdir(tempfile.mkdtemp(prefix=".searchlight-", dir=folder))
        except OSError as error:
            raise InputError(
                folder, f"no place to write ({error.strerror})", "a folder that can be written"
            ) from None


@contextmanager
def run_directory(path: Path) -> Iterator[Path]:
    """A temporary folder beside path to write a run's files in; on leaving, they all appear in path.

    A new path is one rename. In the directory of an earlier run the files of that run which this one does not write
    are removed, then each file is replaced in one step, the summary last: what lies there is of one run. Files that
    are not ours are never touched. If the block raises, path stays as it was; if that
    was for want of space, the files that were finished are kept in a folder that the error names.
    Raises InputError if a run may not write at path (see check_run_directory).
    """
    check_run_directory(path)
    temporary = _beside(path)
    try:
        temporary.mkdir(parents=True)
    except OSError as error:
        raise InputError(path, f"no place to write ({error.strerror})", "a folder that can be made") from None
    try:
        yield temporary
        check_run_directory(path)
        _publish(temporary, path)
    except Exception as error:
        if not _is_full(error, temporary):
            raise
        raise _kept(temporary, path) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _is_full(error: Exception, folder: Path) -> bool:
    """Whether an error is for want of space; libraries that write files do not always say so."""
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return True
    return not isinstance(error, InputError) and shutil.disk_usage(folder).free < _LEAST_FREE_BYTES


def _kept(temporary: Path, path: Path) -> InputError:
    """Keep what is finished of a run that the disk has no room for, and say where."""
    kept = path.absolute().with_name(f"{path.absolute().name}.incomplete")
    for part in temporary.rglob("*.part"):
        part.unlink()
    shutil.rmtree(kept, ignore_errors=True)
    os.replace(temporary, kept)
    names = ", ".join(sorted(p.name for p in kept.iterdir())) or "nothing"
    return InputError(path, f"a full disk; what was finished is in {kept} ({names})", "more space")


def _publish(temporary: Path, path: Path) -> None:
    names = sorted(p.relative_to(temporary).as_posix() for p in temporary.rglob("*") if p.is_file())
    (temporary / FILE_LIST).write_text("".join(f"{name}\n" for name in [*names, FILE_LIST]), encoding="utf-8")
    if not path.exists() or _is_empty(path):
        os.replace(temporary, path)
        return
    for stale in _files_of_run(path) - {*names, FILE_LIST}:
        (path / stale).unlink(missing_ok=True)
    files = sorted(p.relative_to(temporary) for p in temporary.rglob("*") if p.is_file())
    for name in sorted(files, key=lambda p: p == Path(SUMMARY_FILE)):
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(temporary / name, path / name)


def add_to_run(path: Path, names: Iterable[str]) -> None:
    """List files that were written into a run's directory later: the next run there removes them with the rest."""
    listed = _files_of_run(path) | {FILE_LIST} | set(names)
    write_text(path / FILE_LIST, "".join(f"{name}\n" for name in sorted(listed)))


def _files_of_run(path: Path) -> set[str]:
    """The names of the files that the run in a directory wrote; no other name is ever in it."""
    try:
        listed = (path / FILE_LIST).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return {found.name for pattern in _UNLISTED for found in path.glob(pattern) if found.is_file()}
    # a list that somebody edited must not reach out of the directory
    return {name for name in listed if (path / name).resolve().is_relative_to(path.resolve()) and name}


def _beside(path: Path) -> Path:
    # the same folder is the same file system: os.replace stays one step
    return path.absolute().with_name(f".{path.absolute().name}.{uuid4().hex}.part")


def _is_empty(path: Path) -> bool:
    return next(path.iterdir(), None) is None


def _is_ours(path: Path) -> bool:
    if (path / UNFINISHED).is_file():
        return True
    try:
        summary = json.loads((path / SUMMARY_FILE).read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(summary, dict) and summary.get("written_by") == WRITTEN_BY

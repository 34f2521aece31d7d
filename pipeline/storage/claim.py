"""One run at a time writes a run directory."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

from pipeline.errors import InputError
from pipeline.leftovers import swept
from pipeline.storage.whole_or_nothing import check_run_directory


@contextmanager
def claimed(path: Path) -> Iterator[None]:
    """Within it the run directory is this process's alone.

    Raises InputError if another run has it, or if a run may not write there (see check_run_directory). The lock is
    a file beside the directory that is gone afterwards; a process that dies leaves no lock behind, only the file.
    """
    check_run_directory(path)
    path.absolute().parent.mkdir(parents=True, exist_ok=True)
    lock = _lock_of(path)
    try:
        with lock.open("a+", encoding="ascii") as file:
            if not (_locked(file, lock) or _locked_soon(file, lock)):
                file.seek(0)
                owner = file.read(20).strip() or "unknown"
                raise InputError(
                    path, f"a folder that another run writes (process {owner})", "another --out"
                ) from None
            file.truncate(0)
            file.write(f"{os.getpid()}\n")
            file.flush()
            with swept(lock):
                yield
    finally:
        # From before the file was there: a signal may raise between any two steps of the above.
        _remove_if_free(lock)


def writer_of(path: Path) -> str | None:
    """Number of the process that writes a run directory at this moment; None: nobody does. Takes nothing."""
    lock = _lock_of(path)
    try:
        with lock.open("r", encoding="ascii") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                return file.read(20).strip() or "unknown"
    except OSError:
        pass
    return None


def _lock_of(path: Path) -> Path:
    return path.absolute().with_name(f".{path.absolute().name}.lock")


def _remove_if_free(lock: Path) -> None:
    with suppress(OSError), lock.open("r+", encoding="ascii") as file:
        if _locked(file, lock):
            lock.unlink(missing_ok=True)


def _locked_soon(file: TextIO, lock: Path) -> bool:
    """Once more: ``writer_of`` may just have looked."""
    time.sleep(0.05)
    return _locked(file, lock)


def _locked(file: TextIO, lock: Path) -> bool:
    """Whether the lock is ours now; a file that its owner has just removed locks nothing."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return os.path.samestat(os.fstat(file.fileno()), lock.stat())
    except OSError:
        return False

"""Files and folders that would be left behind if the process ended at once, as a second signal makes it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_PATHS: set[Path] = set()


@contextmanager
def swept(path: Path) -> Iterator[None]:
    """Within it a path, which whoever made it removes in good time, is known to ``sweep``."""
    _PATHS.add(path)
    try:
        yield
    finally:
        _PATHS.discard(path)


def sweep() -> None:
    """Remove all that is known, files and folders. Call it last: nobody may write there any more."""
    for path in list(_PATHS):
        shutil.rmtree(path, ignore_errors=True)
        with suppress(OSError):
            path.unlink()

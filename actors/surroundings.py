"""What must be right around the program before anything heavy is loaded."""

from __future__ import annotations

import io
import os
import stat
import sys
import tempfile
from collections.abc import MutableMapping
from pathlib import Path

#: set by other programs for their own PROJ and GDAL; the wheels carry databases of their own versions, and with
#: another one every coordinate transformation fails
FOREIGN_DATABASES = ("PROJ_LIB", "PROJ_DATA", "GDAL_DATA")


def settle(environment: MutableMapping[str, str] = os.environ) -> None:
    """Call it first: numba, matplotlib and PROJ look at the environment when they are imported."""
    for name in FOREIGN_DATABASES:
        environment.pop(name, None)
    if not _writable(Path(__file__).parent):
        environment.setdefault("NUMBA_CACHE_DIR", str(_own_temporary_folder("numba")))
        environment.setdefault("MPLCONFIGDIR", str(_own_temporary_folder("matplotlib")))
    for stream in (sys.stdout, sys.stderr):
        # a terminal that cannot show a character shows a question mark; it must not end a run
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _writable(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _own_temporary_folder(purpose: str) -> Path:
    """A folder that lasts from run to run and that nobody else can write: numba's cache holds programs."""
    folder = Path(tempfile.gettempdir()) / f"searchlight-{purpose}-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        state = folder.lstat()
    except OSError:
        return Path(tempfile.mkdtemp(prefix=f"searchlight-{purpose}-"))
    is_ours = stat.S_ISDIR(state.st_mode) and state.st_uid == os.getuid() and not state.st_mode & 0o077
    return folder if is_ours else Path(tempfile.mkdtemp(prefix=f"searchlight-{purpose}-"))

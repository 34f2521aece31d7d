"""Memory of the process that nobody uses any more."""

from __future__ import annotations

import ctypes
import gc
from contextlib import suppress


def give_back() -> None:
    """Hand back to the system what was freed; the C library keeps it else, picture for picture of large videos.

    Does nothing where the C library is not GNU's.
    """
    gc.collect()
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)

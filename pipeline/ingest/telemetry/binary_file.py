"""The bytes of a log, with what can be wrong with a file said in one line."""

from __future__ import annotations

from pathlib import Path

from pipeline.errors import InputError

#: a day of an autopilot's log at 10 MB a minute; memory is bounded by it
_MOST_BYTES = 2 * 1024**3


def read_bytes(path: Path, expected: str) -> bytes:
    """The whole file. Raises InputError if there is none, it is empty, too large or cannot be read."""
    try:
        size = path.stat().st_size
        if size > _MOST_BYTES:
            raise InputError(path, f"a file of {size} bytes", f"{expected} of at most {_MOST_BYTES} bytes")
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(path, "no file", expected) from None
    except OSError as error:
        raise InputError(path, f"a file that cannot be read ({error.strerror})", expected) from None
    if not data:
        raise InputError(path, "an empty file", expected)
    return data

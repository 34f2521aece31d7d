"""Bytes to text, in the encodings that people's files have."""

from __future__ import annotations

import codecs
from pathlib import Path

from pipeline.errors import InputError

#: an hour of telemetry at 60 Hz with 400 bytes a sample is less than a fifth of this
_MOST_BYTES = 512 * 1024 * 1024
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


def read_text(path: Path, expected: str) -> str:
    """The text of a file in UTF-8, UTF-16 or Latin-1, line ends as ``\\n``. Raises InputError if it is none."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(
                path, f"a file of {path.stat().st_size} bytes", f"{expected} of at most {_MOST_BYTES}"
            )
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(path, "no file", expected) from None
    except OSError as error:
        raise InputError(path, f"a file that cannot be read ({error.strerror})", expected) from None
    # a file that was cut off in flight may end in zeros
    text = decoded(data).rstrip("\0")
    if text.count("\0") > 0.01 * len(text):
        raise InputError(path, "a file that is not text", expected)
    return text.replace("\0", "").replace("\r\n", "\n").replace("\r", "\n")


def decoded(data: bytes) -> str:
    """Text by its byte order mark; without one UTF-16 if every other byte is zero, else UTF-8, else Latin-1."""
    for mark, name in _MARKS:
        if data.startswith(mark):
            return data[len(mark) :].decode(name, errors="replace")
    head = data[:4096]
    for offset, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        if len(head) > 3 and head[offset::2].count(0) > 0.4 * len(head):
            return data.decode(name, errors="replace")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")

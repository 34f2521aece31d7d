"""Bytes to text, in the encodings that people's tables have."""

from __future__ import annotations

import codecs
from pathlib import Path

from pipeline.errors import InputError

_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))


def decode(data: bytes) -> str:
    """The text: by its byte order mark, else UTF-16 by its zeros, else UTF-8, else Latin-1. Never fails.

    Lines end with a line feed; zero characters, which some exporters pad with, are gone.
    """
    text = data.decode(_encoding(data), errors="replace")
    return text.replace("\0", "").replace("\r\n", "\n").replace("\r", "\n")


def read_text(path: Path, what: str) -> str:
    """The text of a file. what: is expected, in words, for the InputError if it cannot be read."""
    try:
        return decode(path.read_bytes())
    except FileNotFoundError:
        raise InputError(path, "no file", what) from None
    except OSError as error:
        raise InputError(path, f"a file that cannot be read ({error.strerror})", what) from None


def _encoding(data: bytes) -> str:
    for mark, name in _MARKS:
        if data.startswith(mark):
            return name
    head = data[:4096]
    # in UTF-16, every second byte of a table is zero; in a padded file they lie together
    if head[1::2].count(0) > 0.4 * len(head) / 2:
        return "utf-16-le" if head[0::2].count(0) < 0.1 * len(head) / 2 else "latin-1"
    if head[0::2].count(0) > 0.4 * len(head) / 2:
        return "utf-16-be"
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"

"""The packets of an encoded stream in a file: each with its length, 4 bytes big-endian, before it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import InputError
from pipeline.storage.whole_or_nothing import replacing

_LENGTH_BYTES = 4


@contextmanager
def writing_packets(path: Path) -> Iterator[Callable[[bytes], object]]:
    """A function that appends a packet; the file appears when the block is left without an error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary, temporary.open("wb") as file:
        yield lambda data: file.write(len(data).to_bytes(_LENGTH_BYTES, "big") + data)


def read_packets(path: Path) -> Iterator[bytes]:
    """The packets in their order. Raises InputError if the file is cut off."""
    with path.open("rb") as file:
        while header := file.read(_LENGTH_BYTES):
            length = int.from_bytes(header, "big")
            data = file.read(length)
            if len(header) < _LENGTH_BYTES or len(data) < length:
                raise InputError(path, "a stream that is cut off", "a whole one; remove the file")
            yield data

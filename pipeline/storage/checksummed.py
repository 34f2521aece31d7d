"""Files of records that are written whole or not at all, and read whole or not at all."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from pipeline.errors import InputError
from pipeline.storage.whole_or_nothing import replacing

_DIGEST_BYTES = 32
_LENGTH_BYTES = 8
_BLOCK_BYTES = 1 << 20


def write_records(path: Path, kind: str, records: Iterable[bytes]) -> None:
    """Write a file of a kind; until all of it is on the disk, path stays as it was.

    First line: the kind. Then each record after its length (8 bytes, little-endian); last, the SHA-256 of all
    before.
    """
    digest = hashlib.sha256()
    with replacing(path) as temporary, temporary.open("wb") as file:
        for data in _framed(kind, records):
            digest.update(data)
            file.write(data)
        file.write(digest.digest())
        file.flush()
        os.fsync(file.fileno())


def read_records(path: Path, kind: str) -> Iterator[bytes]:
    """The records of a file. Raises InputError, before any record, unless it is whole and of the kind."""
    end = _verify(path, kind)
    return _records(path, kind, end)


def _records(path: Path, kind: str, end: int) -> Iterator[bytes]:
    with path.open("rb") as file:
        file.seek(len(_first_line(kind)))
        while file.tell() < end:
            yield file.read(int.from_bytes(file.read(_LENGTH_BYTES), "little"))


def _verify(path: Path, kind: str) -> int:
    """Where the records end."""
    if not path.is_file():
        raise InputError(path, "no file", f"a {kind}")
    first_line, digest = _first_line(kind), hashlib.sha256()
    end = path.stat().st_size - _DIGEST_BYTES
    with path.open("rb") as file:
        start = file.read(len(first_line))
        if start != first_line:
            raise InputError(path, "another kind of file, or another version", f"a {kind}")
        digest.update(start)
        while file.tell() < end:
            digest.update(file.read(min(_BLOCK_BYTES, end - file.tell())))
        if file.read() != digest.digest():
            raise InputError(
                path, "a file whose checksum does not fit: damaged or cut off", f"a whole {kind}"
            )
    return end


def _framed(kind: str, records: Iterable[bytes]) -> Iterator[bytes]:
    yield _first_line(kind)
    for record in records:
        yield len(record).to_bytes(_LENGTH_BYTES, "little")
        yield record


def _first_line(kind: str) -> bytes:
    return f"{kind}\n".encode("ascii")

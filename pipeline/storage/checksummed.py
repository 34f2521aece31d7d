"""Files of records that are written whole or not at all, and read whole or not at all."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from pipeline.errors import InputError
from pipeline.storage.disk import LOCAL_DISK, Disk

_DIGEST_BYTES = 32
_LENGTH_BYTES = 8
_BLOCK_BYTES = 1 << 20


def write_records(path: Path, kind: str, records: Iterable[bytes], disk: Disk = LOCAL_DISK) -> None:
    """Write a file of a kind; until all of it is on the disk, path stays as it was. Raises OSError.

    First line: the kind. Then each record after its length (8 bytes, little-endian); last, the SHA-256 of all
    before.
    """
    temporary = path.absolute().with_name(f".{path.absolute().name}.{uuid4().hex}.part")
    try:
        _write(disk, temporary, kind, records)
        disk.rename(temporary, path)
        disk.sync_folder(path.absolute().parent)
    except BaseException:
        with suppress(OSError):
            disk.remove(temporary)
        raise


def _write(disk: Disk, path: Path, kind: str, records: Iterable[bytes]) -> None:
    digest = hashlib.sha256()
    file = disk.create(path)
    try:
        for data in _blocks(_framed(kind, records)):
            digest.update(data)
            file.write(data)
        file.write(digest.digest())
        file.sync()
    finally:
        file.close()


def read_records(path: Path, kind: str, disk: Disk = LOCAL_DISK) -> Iterator[bytes]:
    """The records of a file. Raises InputError, before any record, unless it is whole and of the kind."""
    try:
        file = disk.open(path)
    except (FileNotFoundError, IsADirectoryError):
        raise InputError(path, "no file", f"a {kind}") from None
    with file:
        end = _verify(file, path, kind)
    return _records(disk, path, kind, end)


def _records(disk: Disk, path: Path, kind: str, end: int) -> Iterator[bytes]:
    with disk.open(path) as file:
        file.seek(len(_first_line(kind)))
        while file.tell() < end:
            yield file.read(int.from_bytes(file.read(_LENGTH_BYTES), "little"))


def _verify(file: BinaryIO, path: Path, kind: str) -> int:
    """Where the records end."""
    first_line, digest = _first_line(kind), hashlib.sha256()
    end = file.seek(0, 2) - _DIGEST_BYTES
    file.seek(0)
    start = file.read(len(first_line))
    if start != first_line:
        raise InputError(path, "another kind of file, or another version", f"a {kind}")
    digest.update(start)
    while file.tell() < end:
        digest.update(file.read(min(_BLOCK_BYTES, end - file.tell())))
    if file.read() != digest.digest():
        raise InputError(
            path, "a file whose checksum does not fit: damaged or cut off", f"a whole {kind}"
        ) from None
    return end


def _framed(kind: str, records: Iterable[bytes]) -> Iterator[bytes]:
    yield _first_line(kind)
    for record in records:
        yield len(record).to_bytes(_LENGTH_BYTES, "little")
        yield record


def _blocks(pieces: Iterable[bytes]) -> Iterator[bytes]:
    """The same bytes in pieces worth a write."""
    block = bytearray()
    for piece in pieces:
        block += piece
        if len(block) >= _BLOCK_BYTES:
            yield bytes(block)
            block.clear()
    yield bytes(block)


def _first_line(kind: str) -> bytes:
    return f"{kind}\n".encode("ascii")

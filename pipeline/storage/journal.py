"""An append-only log of records that survives a crash at any moment.

Records are appended in memory and committed together: one write and one sync for all. What was committed is read
again after any crash. The files are segments, ``journal-NNNNNN.log``, see journal_segment; a new one begins at each
start and at each checkpoint, after which those before it are needed no more.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pipeline.storage.disk import Disk, WritableFile
from pipeline.storage.journal_segment import GENESIS, Identity, framed, head, read_segment

_PREFIX, _SUFFIX = "journal-", ".log"


@dataclass(frozen=True)
class Position:
    """Where a segment begins. after: the digest that the records before it end with."""

    segment: int
    after: bytes


#: of a journal that has lost nothing since it was new
FIRST = Position(1, GENESIS)


@dataclass(frozen=True)
class Recovered:
    """What a journal held. cut: sentences, one for each file of which something could not be used."""

    records: tuple[bytes, ...]
    cut: tuple[str, ...]


class Journal:
    """Open for appending; recover() makes one. After an OSError only ``begin_again`` may follow."""

    def __init__(self, disk: Disk, folder: Path, identity: Identity, start: Position) -> None:
        """Begins the segment at ``start``; the folder must hold none of its number or after it."""
        self._disk, self._folder, self._identity = disk, folder, identity
        self._segment = start.segment
        self._waiting: list[bytes] = []
        self._file, self._digest = self._begin(start)

    @property
    def waiting(self) -> int:
        """Records appended since the last commit."""
        return len(self._waiting)

    def append(self, record: bytes) -> None:
        """Add a record, in memory so far."""
        self._waiting.append(record)

    def commit(self) -> None:
        """On return everything appended before is on the disk. OSError: perhaps some of it, in order."""
        if not self._waiting:
            return
        pieces, digest = [], self._digest
        for record in self._waiting:
            data, digest = framed(record, digest)
            pieces.append(data)
        self._file.write(b"".join(pieces))
        self._file.sync()
        self._digest = digest
        self._waiting.clear()

    def rotate(self) -> Position:
        """Commit, and go on in a new segment; where it begins is what a checkpoint must remember."""
        self.commit()
        self._file.close()
        return self._go_on(Position(self._segment + 1, self._digest))

    def begin_again(self) -> Position:
        """After an OSError: forget what was not committed, which a checkpoint must hold, and go on in a new segment.

        The gap breaks the chain of digests: what comes after it is never read as if it followed what was before.
        """
        self._waiting.clear()
        with suppress(OSError):
            self._file.close()
        return self._go_on(
            Position(self._segment + 1, hashlib.blake2b(self._digest, digest_size=16).digest())
        )

    def forget(self, segment: int) -> None:
        """Remove the segments before one, which a checkpoint has made superfluous."""
        for name in self._disk.names(self._folder):
            if 0 < _number(name) < segment:
                self._disk.remove(self._folder / name)

    def close(self) -> None:
        """Commit; nothing more is appended."""
        self.commit()
        self._file.close()

    def _go_on(self, position: Position) -> Position:
        self._file, self._digest = self._begin(position)
        self._segment = position.segment
        return position

    def _begin(self, position: Position) -> tuple[WritableFile, bytes]:
        data, digest = head(self._identity, position.segment, position.after)
        file = self._disk.create(self._folder / _name(position.segment))
        file.write(data)
        file.sync()
        self._disk.sync_folder(self._folder)
        return file, digest


def recover(
    disk: Disk, folder: Path, identity: Identity, start: Position = FIRST
) -> tuple[Journal, Recovered]:
    """Read a folder's journal from ``start`` on and open it for more; a new journal where there is none.

    Kept is everything up to the first record that is torn or flipped; the rest is cut off, and said. Raises InputError
    for a journal of another mission or version.
    """
    disk.make_folder(folder)
    records: list[bytes] = []
    cut: list[str] = []
    expected = start
    for name in _segments(disk, folder):
        if _number(name) < start.segment:
            continue  # kept for an earlier checkpoint
        segment = read_segment(disk, folder / name, identity)
        if Position(segment.number, segment.after) != expected:
            cut.append(_cut(disk, folder / name, 0, segment.size, segment.fault or "it does not follow"))
            continue
        records += segment.records
        expected = Position(segment.number + 1, segment.digest)
        if segment.fault is not None:
            cut.append(_cut(disk, folder / name, segment.end, segment.size, segment.fault))
    return Journal(disk, folder, identity, expected), Recovered(tuple(records), tuple(cut))


def require_identity(disk: Disk, folder: Path, identity: Identity) -> None:
    """Raises InputError if a folder holds a journal of another mission or version; changes nothing."""
    for name in _segments(disk, folder):
        read_segment(disk, folder / name, identity)


def _cut(disk: Disk, path: Path, end: int, size: int, why: str) -> str:
    """Cut a segment off, or remove all of it, and say so."""
    if end:
        disk.truncate(path, end)
    else:
        disk.remove(path)
    return f"{path.name}: cut off {size - end} of {size} bytes, from byte {end} on: {why}"


def _segments(disk: Disk, folder: Path) -> Sequence[str]:
    return sorted((name for name in disk.names(folder) if _number(name) > 0), key=_number)


def _name(segment: int) -> str:
    return f"{_PREFIX}{segment:06d}{_SUFFIX}"


def _number(name: str) -> int:
    """Of a segment's file; 0 for any other."""
    digits = name[len(_PREFIX) : -len(_SUFFIX)]
    ours = name.startswith(_PREFIX) and name.endswith(_SUFFIX) and digits.isdigit()
    return int(digits) if ours else 0

"""Every call that the journal and its checkpoints make to the file system, in one object.

A test hands in another one: a disk that fails, fills up, or forgets at a power cut what was not synced.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO, Protocol


class WritableFile(Protocol):
    """A new file, written from its beginning to its end."""

    def write(self, data: bytes) -> None:
        """Append all of data, or raise OSError; some of it may be there then."""

    def sync(self) -> None:
        """Return once what was written survives a power cut; the file's name may not yet, see Disk.sync_folder."""

    def close(self) -> None:
        """Nothing more is written. Not a sync."""


class Disk(Protocol):
    """Files by path. Every method may raise OSError."""

    def names(self, folder: Path) -> list[str]:
        """What lies in a folder, in order; nothing if there is no such folder."""

    def make_folder(self, folder: Path) -> None:
        """Make a folder that may exist, with those above it."""

    def open(self, path: Path) -> BinaryIO:
        """A file to be read."""

    def create(self, path: Path) -> WritableFile:
        """A new and empty file; one that is there is emptied."""

    def truncate(self, path: Path, size: int) -> None:
        """Cut a file off after so many bytes, and sync it."""

    def rename(self, old: Path, new: Path) -> None:
        """Give a file another name in one step; a file that has it is gone."""

    def remove(self, path: Path) -> None:
        """Remove a file that may be gone already."""

    def sync_folder(self, folder: Path) -> None:
        """Return once the names in a folder survive a power cut."""


class _File:
    def __init__(self, path: Path) -> None:
        # unbuffered: after write() the data is the kernel's, and a killed process loses none of it
        self._file = path.open("wb", buffering=0)

    def write(self, data: bytes) -> None:
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) or 0 :]

    def sync(self) -> None:
        os.fsync(self._file.fileno())

    def close(self) -> None:
        self._file.close()


class LocalDisk:
    """The machine's own file system."""

    def names(self, folder: Path) -> list[str]:
        """See Disk."""
        return sorted(os.listdir(folder)) if folder.is_dir() else []

    def make_folder(self, folder: Path) -> None:
        """See Disk."""
        folder.mkdir(parents=True, exist_ok=True)

    def open(self, path: Path) -> BinaryIO:
        """See Disk."""
        return path.open("rb")

    def create(self, path: Path) -> WritableFile:
        """See Disk."""
        return _File(path)

    def truncate(self, path: Path, size: int) -> None:
        """See Disk."""
        with path.open("r+b") as file:
            file.truncate(size)
            os.fsync(file.fileno())

    def rename(self, old: Path, new: Path) -> None:
        """See Disk."""
        os.replace(old, new)

    def remove(self, path: Path) -> None:
        """See Disk."""
        path.unlink(missing_ok=True)

    def sync_folder(self, folder: Path) -> None:
        """See Disk."""
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


LOCAL_DISK = LocalDisk()

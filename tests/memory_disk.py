"""A disk in memory that dies where it is told to, and then forgets what was not synced.

Each write, sync, rename, and so on is a step; ``crash_at`` (from 1) and ``when`` say at which one and on which side of
it the process dies: ``during`` leaves half of a write. ``after_crash`` is what the next process finds: after a kill all
that was done; after a power cut, of what was not synced, any part in any order, writes torn. Names and contents are
synced apart, as file systems do: a rename may survive whose file's content does not, and one name without another.
"""

from __future__ import annotations

import errno
import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np

When = Literal["before", "during", "after"]


class CrashError(BaseException):
    """The process is dead: no handler of ours may catch it."""


@dataclass
class Content:
    """synced: bytes on the disk. pending: (offset, data) written since. Both in the kernel's view of the file."""

    synced: bytes = b""
    pending: list[tuple[int, bytes]] = field(default_factory=list)

    @property
    def seen(self) -> bytes:
        return _patched(self.synced, self.pending)

    def lost(self, rng: np.random.Generator) -> Content:
        """After a power cut: some of the pending writes, perhaps torn."""
        kept = []
        for offset, data in self.pending:
            fate = rng.integers(3)
            if fate == 0:
                kept.append((offset, data))
            elif fate == 1:
                kept.append((offset, data[: int(rng.integers(len(data) + 1))]))
        return Content(_patched(self.synced, kept))


def _patched(data: bytes, patches: list[tuple[int, bytes]]) -> bytes:
    whole = bytearray(data)
    for offset, patch in patches:
        whole.extend(b"\0" * (offset + len(patch) - len(whole)))
        whole[offset : offset + len(patch)] = patch
    return bytes(whole)


class MemoryDisk:
    """See Disk. full_at: the step from which on writes raise ENOSPC, until room() is called."""

    def __init__(self, crash_at: int = 0, when: When = "after", full_at: int = 0) -> None:
        self.steps = 0
        self._crash_at, self._when, self._full_at = crash_at, when, full_at
        self._dead = False
        self._names: dict[Path, Content] = {}  # as a process sees them
        self._synced: dict[Path, Content] = {}  # as they are on the disk
        self._folders: set[Path] = set()

    def after_crash(self, power_cut: bool, seed: int) -> MemoryDisk:
        rng, after = np.random.default_rng(seed), MemoryDisk()
        after._folders = set(self._folders)
        names = self._names
        if power_cut:
            everything = sorted(self._names.keys() | self._synced.keys())
            changed = [p for p in everything if self._names.get(p) is not self._synced.get(p)]
            names = dict(self._synced)
            for path in changed:
                if rng.integers(2):
                    names.pop(path, None)
                    if path in self._names:
                        names[path] = self._names[path]
        for path, content in names.items():
            of_file = content.lost(rng) if power_cut else Content(content.seen)
            after._names[path] = after._synced[path] = of_file
        return after

    def copy(self) -> MemoryDisk:
        return self.after_crash(power_cut=False, seed=0)

    def room(self) -> None:
        self._full_at = 0

    def damage(self, path: Path, at: int, mask: int) -> None:
        """Flip bits of a byte of a file."""
        data = bytearray(self._names[path].seen)
        data[at] ^= mask
        self._names[path] = self._synced[path] = Content(bytes(data))

    def cut(self, path: Path, size: int) -> None:
        self._names[path] = self._synced[path] = Content(self._names[path].seen[:size])

    def read(self, path: Path) -> bytes:
        return self._names[path].seen

    def names(self, folder: Path) -> list[str]:
        self._alive()
        return sorted(path.name for path in self._names if path.parent == folder)

    def make_folder(self, folder: Path) -> None:
        self._alive()
        self._folders.add(folder)

    def open(self, path: Path) -> BinaryIO:
        self._alive()
        if path not in self._names:
            raise FileNotFoundError(errno.ENOENT, "No such file or directory", str(path))
        return io.BytesIO(self._names[path].seen)

    def create(self, path: Path) -> _MemoryFile:
        if self._step():
            self._names[path] = Content()
        self._after()
        return _MemoryFile(self, self._names[path])

    def truncate(self, path: Path, size: int) -> None:
        content = self._names[path]
        if self._step():
            content.synced, content.pending = content.seen[:size], []
        self._after()

    def rename(self, old: Path, new: Path) -> None:
        if self._step():
            self._names[new] = self._names.pop(old)
        self._after()

    def remove(self, path: Path) -> None:
        if self._step():
            self._names.pop(path, None)
        self._after()

    def sync_folder(self, folder: Path) -> None:
        if self._step():
            self._synced = {p: c for p, c in self._synced.items() if p.parent != folder}
            self._synced |= {p: c for p, c in self._names.items() if p.parent == folder}
        self._after()

    def _alive(self) -> None:
        if self._dead:
            raise CrashError

    def _step(self, writes: bool = False) -> bool:
        """Count a step; whether it is to be done in full. Raises CrashError before it."""
        self._alive()
        self.steps += 1
        if writes and self._full_at and self.steps >= self._full_at:
            raise OSError(errno.ENOSPC, "No space left on device")
        if self.steps == self._crash_at and self._when == "before":
            self._dead = True
            raise CrashError
        return not (self.steps == self._crash_at and self._when == "during")

    def _after(self) -> None:
        if self.steps == self._crash_at:
            self._dead = True
            raise CrashError


class _MemoryFile:
    def __init__(self, disk: MemoryDisk, content: Content) -> None:
        self._disk, self._content = disk, content

    def write(self, data: bytes) -> None:
        whole = self._disk._step(writes=True)
        size = len(self._content.seen)
        self._content.pending.append((size, data if whole else data[: len(data) // 2]))
        self._disk._after()

    def sync(self) -> None:
        if self._disk._step():
            self._content.synced, self._content.pending = self._content.seen, []
        self._disk._after()

    def close(self) -> None:
        pass

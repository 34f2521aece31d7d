"""A reducer that survives its process: what it acknowledges is on the disk before.

Every message that is taken goes into a journal and into the map. A commit makes all that was taken since the last one
durable at once; only then is it acknowledged. From time to time a checkpoint of the whole state is written, after
which the journal before it is needed no more. A new one begins with the newest checkpoint and the journal after it.

A disk that is full or broken does not stop the search: the map goes on in memory, nothing more is acknowledged, and
``trouble`` says why. Each checkpoint that is due tries again; the first that succeeds holds everything, and the
journal goes on after it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgpack

from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.messages import Message, pack, unpack
from pipeline.mission.checkpoint import load_checkpoint, read_beside, save_checkpoint
from pipeline.mission.ranges import Ranges
from pipeline.mission.stages.reducer import ReducerStage
from pipeline.storage.disk import LOCAL_DISK, Disk
from pipeline.storage.journal import FIRST, Position, recover, require_identity
from pipeline.storage.journal_segment import Identity

#: of the records in the journal: messages as they travel
RECORD_KIND = "searchlight results 1"
#: before a record that is no message; a message begins with a map
_COMMAND = b"\0"
_PREFIX, _SUFFIX = "checkpoint-", ".state"
_LOG = Log("mission")
#: stream, detector, epoch: within it messages are numbered without gaps
Numbered = tuple[str, str, int]


@dataclass(frozen=True)
class JournalParams:
    """commit_s: a result is on the disk at most so long after it was taken, and is acknowledged then; a longer time
    saves syncs, which wear cards out. checkpoint_s: so much time passes between checkpoints; a longer one makes the
    journal longer, and a restart slower. checkpoints: so many are kept, with the journal after the oldest: one more
    than is needed if no disk ever spoils what it has.
    """

    commit_s: float = 0.05
    checkpoint_s: float = 60.0
    checkpoints: int = 2

    def __post_init__(self) -> None:
        for name, value in (("commit_s", self.commit_s), ("checkpoint_s", self.checkpoint_s)):
            if not value >= 0.0:
                raise InputError(name, f"{value:g} s", "a time of 0 s or more")
        if self.checkpoints < 1:
            raise InputError("checkpoints", str(self.checkpoints), "1 or more")


@dataclass(frozen=True)
class Acknowledgement:
    """What of a substream is on the disk: every message numbered below ``end``, but for the gaps.

    gaps: numbers that did not come, as ranges from the first to one past the last.
    """

    stream: str
    detector: str
    epoch: int
    end: int
    gaps: tuple[tuple[int, int], ...] = ()

    def __contains__(self, sequence: int) -> bool:
        return 0 <= sequence < self.end and not any(a <= sequence < b for a, b in self.gaps)


class DurableReducer:
    """stage: the reducer. cut: sentences on what of the folder could not be used. recovered: messages found there.

    repeated: messages that came again, by stream and detector; they change nothing. trouble: why nothing is written
    at present, or None. now_s arguments: of one clock that never goes back.
    """

    def __init__(
        self,
        stage: ReducerStage,
        folder: Path,
        fingerprint: str,
        now_s: float,
        params: JournalParams | None = None,
        disk: Disk = LOCAL_DISK,
    ) -> None:
        """stage: a new one, of the mission. Raises InputError if the folder is of another mission or version."""
        self.stage = stage
        self.repeated: Counter[tuple[str, str]] = Counter()
        self.trouble: str | None = None
        self._folder, self._fingerprint, self._disk = folder, fingerprint, disk
        self._params = params or JournalParams()
        self._taken: dict[Numbered, Ranges] = {}
        self._news: set[Numbered] = set()
        self._commit_due_s: float | None = None
        self._checkpoint_due_s = now_s + self._params.checkpoint_s
        identity = Identity(RECORD_KIND, fingerprint)
        disk.make_folder(folder)
        require_identity(disk, folder, identity)
        start, cut = self._load()
        self._journal, found = recover(disk, folder, identity, start)
        for record in found.records:
            self._apply_record(record)
        self.recovered = sum(len(numbers) for numbers in self._taken.values())
        self.cut = (*cut, *found.cut)
        self._since_checkpoint = len(found.records)
        self._acknowledged: dict[Numbered, Acknowledgement] = {}
        self._news = set(self._taken)
        self._acknowledge()
        for sentence in self.cut:
            _LOG.warning("journal cut off", what=sentence)

    @property
    def acknowledged(self) -> tuple[Acknowledgement, ...]:
        """All that was acknowledged so far, one for each substream and epoch."""
        return tuple(self._acknowledged.values())

    @property
    def taken(self) -> dict[tuple[str, str], int]:
        """Messages that came, each once, by stream and detector."""
        counts: Counter[tuple[str, str]] = Counter()
        for (stream, detector, _), numbers in self._taken.items():
            counts[stream, detector] += len(numbers)
        return dict(counts)

    def holds(self, message: Message) -> bool:
        """Whether a message was taken, and need not come again."""
        return message.sequence in self._taken.get(_numbered(message), ())

    def push(self, message: Message, now_s: float) -> None:
        """Take a message. It is acknowledged by a later ``tick``, at most commit_s after this."""
        key = _numbered(message)
        if key[:2] not in self.stage.received:
            self.stage.push(message)  # refused and counted
            return
        if self._commit_due_s is None:
            self._commit_due_s = now_s + self._params.commit_s
        self._news.add(key)
        if self.holds(message):
            self.repeated[key[:2]] += 1
            return
        if self.trouble is None:
            self._journal.append(pack(message))
        self._since_checkpoint += 1
        self._take(message)

    def open_again(self, stream: str, detector: str, epoch: int, assignment: str = "") -> None:
        """As the stage does; on the disk with the next commit."""
        self._command("open_again", stream, detector, epoch, assignment)

    def close(self, stream: str, detector: str, epoch: int, reason: str) -> None:
        """As the stage does; on the disk with the next commit."""
        self._command("close", stream, detector, epoch, reason)

    @property
    def due_s(self) -> float:
        """When the next ``tick`` is due."""
        due = (self._checkpoint_due_s, self._commit_due_s)
        return min(moment for moment in due if moment is not None)

    def tick(self, now_s: float) -> tuple[Acknowledgement, ...]:
        """Commit, or write a checkpoint, whichever is due; what is new on the disk for it."""
        if now_s >= self._checkpoint_due_s:
            self._checkpoint_due_s = now_s + self._params.checkpoint_s
            return self.checkpoint() if self._since_checkpoint or self.trouble else ()
        if self._commit_due_s is not None and now_s >= self._commit_due_s:
            return self.commit()
        return ()

    def commit(self) -> tuple[Acknowledgement, ...]:
        """Put on the disk what was taken; acknowledgements of the substreams of which something came."""
        self._commit_due_s = None
        if self.trouble is None:
            try:
                self._journal.commit()
            except OSError as error:
                self._in_trouble(error)
        return self._acknowledge()

    def checkpoint(self) -> tuple[Acknowledgement, ...]:
        """Write the whole state, and drop what it makes superfluous; acknowledgements as of ``commit``."""
        self._commit_due_s = None
        try:
            position = self._journal.rotate() if self.trouble is None else self._journal.begin_again()
            self._save(position)
        except OSError as error:
            self._in_trouble(error)
            return ()
        self._since_checkpoint = 0
        if self.trouble is not None:
            _LOG.event("journal goes on", folder=self._folder)
            self.trouble = None
        return self._acknowledge()

    def finish(self) -> tuple[Acknowledgement, ...]:
        """Commit, then apply what is still held back, which is nothing that a restart would not do again."""
        acknowledgements = self.commit()
        self.stage.finish()
        return acknowledgements

    def _command(self, name: str, *arguments: object) -> None:
        record = _COMMAND + msgpack.packb([name, *arguments])
        if self.trouble is None:
            self._journal.append(record)
        self._since_checkpoint += 1
        self._apply_record(record)

    def _apply_record(self, record: bytes) -> None:
        if not record.startswith(_COMMAND):
            self._take(unpack(record))
            return
        name, *arguments = msgpack.unpackb(record[len(_COMMAND) :])
        if name == "open_again":
            self.stage.open_again(*arguments)
        else:
            self.stage.close(*arguments)

    def _take(self, message: Message) -> None:
        self._taken.setdefault(_numbered(message), Ranges()).add(message.sequence)
        self.stage.push(message)

    def _acknowledge(self) -> tuple[Acknowledgement, ...]:
        """What is news and on the disk: all that was taken, unless there is trouble."""
        if self.trouble is not None:
            return ()
        new = {key: Acknowledgement(*key, self._taken[key].end, self._taken[key].gaps) for key in self._news}
        self._news.clear()
        self._acknowledged |= new
        return tuple(new.values())

    def _in_trouble(self, error: OSError) -> None:
        if self.trouble is None:
            _LOG.warning("journal stops", folder=self._folder, error=str(error))
        self.trouble = f"{self._folder}: {error.strerror or error}"

    def _save(self, position: Position) -> None:
        beside = {
            "fingerprint": self._fingerprint,
            "segment": position.segment,
            "after": position.after,
            "taken": [(*key, numbers.ranges) for key, numbers in sorted(self._taken.items())],
        }
        save_checkpoint(self._folder / _name(position.segment), self.stage, beside, self._disk)
        kept = self._checkpoints()[: self._params.checkpoints]
        for segment in self._checkpoints()[len(kept) :]:
            self._disk.remove(self._folder / _name(segment))
        if len(kept) == self._params.checkpoints:
            self._journal.forget(kept[-1])

    def _load(self) -> tuple[Position, tuple[str, ...]]:
        """Read the newest checkpoint that is whole; where the journal goes on after it, and what was not whole."""
        for name in self._disk.names(self._folder):
            if name.endswith(".part"):  # of a checkpoint that was never finished
                self._disk.remove(self._folder / name)
        faults = []
        for segment in self._checkpoints():
            path = self._folder / _name(segment)
            try:
                beside = read_beside(path, self._disk)
            except InputError as error:
                faults.append(f"{path.name}: not used: {error.found}")
                self._disk.remove(path)
                continue
            self._restore(path, beside)
            return Position(beside["segment"], beside["after"]), tuple(faults)
        return FIRST, tuple(faults)

    def _restore(self, path: Path, beside: dict[str, Any]) -> None:
        if beside["fingerprint"] != self._fingerprint:
            found = "the checkpoint of another mission, of other input files, or of another version"
            raise InputError(path, found, "the mission, files and Searchlight that wrote it")
        load_checkpoint(path, self.stage, self._disk)
        self._taken = {tuple(key): Ranges(ranges) for *key, ranges in beside["taken"]}

    def _checkpoints(self) -> list[int]:
        """Numbers of the checkpoints in the folder, the newest first."""
        numbers = [_number(name) for name in self._disk.names(self._folder)]
        return sorted((number for number in numbers if number), reverse=True)


def _numbered(message: Message) -> Numbered:
    return message.stream, message.detector, message.epoch


def _name(segment: int) -> str:
    return f"{_PREFIX}{segment:06d}{_SUFFIX}"


def _number(name: str) -> int:
    digits = name[len(_PREFIX) : -len(_SUFFIX)]
    ours = name.startswith(_PREFIX) and name.endswith(_SUFFIX) and digits.isdigit()
    return int(digits) if ours else 0

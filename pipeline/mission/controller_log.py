"""The controller's log as a file: played again, it must give the orders that were given in flight.

Gzip of JSON lines. The first says what it is and holds the problem that the mission began with; every other one is an
event, when it was taken, and what was ordered. It is flushed after each round, so that a run that is killed leaves all
of its log but the last round.
"""

from __future__ import annotations

import gzip
import json
import zlib
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, get_args

from pipeline.allocation.plan import Assignment
from pipeline.allocation.problem import Deadline, Detector, MachineLimit, Problem
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.mission.controller.controller import step
from pipeline.mission.controller.events import Event, FailedSubstream, LinkMeasure, Unserved
from pipeline.mission.controller.recorded import Recorded
from pipeline.mission.controller.state import MissionState, begin
from pipeline.mission.controller.substreams import Substream
from pipeline.sensor.setup import Setup, Tiling
from pipeline.storage.plain_records import from_plain, to_plain

#: its name within the folder of a run's logs
CONTROLLER_LOG = "controller.jsonl.gz"
_FORMAT = "searchlight controller log 2"
_PARTS = (
    *(Problem, MachineLimit, Detector, Deadline, Setup, Tiling),
    *(Assignment, Substream, FailedSubstream, LinkMeasure, Unserved),
)
_CLASSES = {c.__name__: c for c in (*get_args(Event), *_PARTS)}
_LOG = Log("mission")


class ControllerLog:
    """The file of a mission that goes on. What cannot be written (a full disk) ends the log and not the mission."""

    def __init__(self, path: Path, problem: Problem, begun_s: float, here: Collection[str]) -> None:
        """begun_s, here: as given to ``begin``."""
        self._path = path
        self._file: gzip.GzipFile | None = None
        try:
            self._file = gzip.GzipFile(path, "wb", compresslevel=4)
        except OSError as error:
            self._given_up(error)
        head = {"format": _FORMAT, "begun_s": begun_s, "here": sorted(here), "problem": to_plain(problem)}
        self._write([head])

    def append(self, recorded: Iterable[Recorded]) -> None:
        """Add what was taken and ordered."""
        self._write(
            {"at_s": one.at_s, "event": to_plain(one.event), "orders": to_plain(one.orders)}
            for one in recorded
        )

    def close(self) -> None:
        """Nothing more will come."""
        if self._file is not None:
            with suppress(OSError):
                self._file.close()
            self._file = None

    def _write(self, lines: Iterable[dict[str, Any]]) -> None:
        if self._file is None:
            return
        try:
            for line in lines:
                self._file.write(json.dumps(line, separators=(",", ":")).encode("utf-8") + b"\n")
            self._file.flush()
        except OSError as error:
            self._given_up(error)

    def _given_up(self, error: OSError) -> None:
        _LOG.warning("no more of the controller's log", file=str(self._path), reason=str(error.strerror))
        self.close()


def replayed(path: Path) -> tuple[MissionState, int]:
    """The state at the end of a log, and how many events it has.

    Raises InputError if it is none, or if ``step`` orders something else today than was ordered in flight.
    """
    lines = _lines(path)
    head = next(lines, None)
    if not isinstance(head, dict) or head.get("format") != _FORMAT:
        raise InputError(path, "no log of a mission controller of this version", f"a {CONTROLLER_LOG}")
    number = 0
    try:
        state = begin(from_plain(head["problem"], _CLASSES), head["begun_s"], here=head["here"])
        for number, line in enumerate(lines, start=1):
            event = from_plain(line["event"], _CLASSES)
            state, orders = step(state, event, line["at_s"])
            now, then = to_plain(tuple(orders)), line["orders"]
            if now != then:
                found = f"event {number}, {type(event).__name__}: ordered in flight {then}, now {now}"
                raise InputError(path, found, "the same orders")
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        found = f"line {number + 1}, which is no part of such a log: {error!r}"
        raise InputError(path, found, f"a {CONTROLLER_LOG} as it was written") from None
    return state, number


def _lines(path: Path) -> Iterator[dict[str, Any]]:
    """All whole lines; the last one of a run that was killed may be cut off."""
    rest = b""
    try:
        with gzip.open(path, "rb") as file, suppress(EOFError):
            while data := file.read1(1 << 20):
                *whole, rest = (rest + data).split(b"\n")
                yield from map(json.loads, whole)
    except (OSError, ValueError, zlib.error) as error:
        raise InputError(path, f"what cannot be read: {error}", f"a {CONTROLLER_LOG}") from None

"""What reviewers decided about places: a log that only grows, and what stands of it.

A decision is of a place on the ground, not of a number: numbers change while a map grows. Taking one back is a line of
its own. A reviewer's later word on a place replaces the earlier one; two reviewers count both.
"""

from __future__ import annotations

import fcntl
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from pipeline.errors import InputError

FILE = "decisions.jsonl"
Kind = Literal["confirm", "reject", "note", "undo"]
KINDS: tuple[str, ...] = get_args(Kind)
#: a reviewer who looks at the pictures of a place is right with this probability, whatever is there
REVIEWER_RIGHT = 0.95
#: what one confirmation adds to the log-odds of a place, and a rejection takes: ln 19
WEIGHT = math.log(REVIEWER_RIGHT / (1.0 - REVIEWER_RIGHT))
#: a place is the one that was decided on if it is not farther away than this, or than its error ellipse is long, metres
SAME_PLACE_M = 3.0
_LONGEST = {"who": 40, "text": 500}


@dataclass(frozen=True)
class Decision:
    """number: from 1, the line of the log. at: ISO 8601, UTC. place: the number it had then. undoes: number of the
    decision that an undo takes back, else 0.
    """

    number: int
    at: str
    who: str
    kind: Kind
    place: int
    class_name: str
    latitude_deg: float
    longitude_deg: float
    text: str = ""
    undoes: int = 0


@dataclass(frozen=True)
class Log:
    """decisions: in their order. unreadable: lines that are no decision, such as one that a power cut has cut off."""

    decisions: tuple[Decision, ...]
    unreadable: int

    @property
    def standing(self) -> tuple[Decision, ...]:
        """Those that were not taken back; an undo is none itself."""
        undone = {d.undoes for d in self.decisions if d.kind == "undo"}
        return tuple(d for d in self.decisions if d.kind != "undo" and d.number not in undone)


def read_log(run: Path) -> Log:
    """Of a run directory; empty where nobody has decided anything."""
    try:
        lines = (run / FILE).read_bytes().split(b"\n")
    except FileNotFoundError:
        return Log((), 0)
    found = [_decision(line) for line in lines if line.strip()]
    return Log(tuple(d for d in found if d is not None), sum(d is None for d in found))


def append(run: Path, at: str, said: Mapping[str, Any]) -> Decision:
    """Write a decision down, to the disk, before it counts; several servers of one run may do so at once.

    said: the fields of a Decision but number and at. Raises InputError for what is none, OSError for a full disk.
    """
    with (run / FILE).open("a+b") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        log = read_log(run)
        number = max((d.number for d in log.decisions), default=0) + 1
        decision = _checked(log, dict(said) | {"number": number, "at": at})
        file.seek(0, os.SEEK_END)
        # what a power cut has cut off must not swallow the next line
        begin = b"\n" if file.tell() and not _ends_with_newline(run / FILE) else b""
        file.write(begin + json.dumps(asdict(decision), ensure_ascii=False).encode("utf-8") + b"\n")
        file.flush()
        os.fsync(file.fileno())
    return decision


def _ends_with_newline(path: Path) -> bool:
    return path.read_bytes()[-1:] == b"\n"


def _checked(log: Log, values: dict[str, Any]) -> Decision:
    decision = Decision(**values)
    if decision.kind not in KINDS:
        raise InputError("kind", repr(decision.kind)[:60], ", ".join(KINDS))
    for name, longest in _LONGEST.items():
        text = getattr(decision, name)
        if not isinstance(text, str) or len(text) > longest or (name == "who" and not text.strip()):
            raise InputError(name, repr(text)[:60], f"a text of at most {longest} characters")
    if decision.kind == "note" and not decision.text.strip():
        raise InputError("text", "an empty note", "what is to be noted")
    if decision.kind == "undo" and not any(
        d.number == decision.undoes and d.who == decision.who for d in log.standing
    ):
        raise InputError("undoes", str(decision.undoes), "a decision of the same reviewer that stands")
    return decision


def _decision(line: bytes) -> Decision | None:
    try:
        decision = Decision(**json.loads(line))
    except (ValueError, TypeError):
        return None
    numbers = (
        decision.number,
        decision.place,
        decision.undoes,
        decision.latitude_deg,
        decision.longitude_deg,
    )
    usable = all(isinstance(n, int | float) and math.isfinite(n) for n in numbers)
    return decision if usable and decision.kind in KINDS else None


def votes(standing: Sequence[Decision]) -> dict[str, Decision]:
    """Of one place: each reviewer's last confirmation or rejection."""
    return {d.who: d for d in standing if d.kind in ("confirm", "reject")}


def net_votes(standing: Sequence[Decision]) -> int:
    """Confirmations less rejections of one place."""
    return sum(1 if d.kind == "confirm" else -1 for d in votes(standing).values())


def decided_probability(probability: float, net: int) -> float:
    """A probability 0..1 after so many confirmations more than rejections: each is a likelihood ratio of 19."""
    if net == 0:
        return probability
    p = min(max(probability, 1e-9), 1.0 - 1e-9)
    return 1.0 / (1.0 + math.exp(-(math.log(p / (1.0 - p)) + net * WEIGHT)))

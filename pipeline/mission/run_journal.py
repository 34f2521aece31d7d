"""What a run directory keeps while its run goes on: all that is needed to go on after everything was killed.

``journal/run.json`` says which run it is; beside it lie the reducer's checkpoints and journal. A run that has come to
its end removes the folder. One that was ended early keeps it, with the file PUBLISHED: what it found is written.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pipeline.allocation.plan import Plan, plan_from_json, plan_to_json
from pipeline.errors import InputError
from pipeline.ingest.finding import Finding
from pipeline.mission.durable_reducer import DurableReducer, JournalParams
from pipeline.mission.input_files import input_digests
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.stages.reducer import ReducerStage
from pipeline.storage.code_digest import code_sha256
from pipeline.storage.whole_or_nothing import UNFINISHED, write_text

PUBLISHED = "published"
_RECORD = Path(UNFINISHED).name
_FORMAT = "searchlight run in progress 1"


@dataclass(frozen=True)
class RunRecord:
    """mission, onto: paths. pace: of the FinishedRun. code: of the program. files: path -> digest. plan: a document."""

    mission: str
    onto: str | None
    pace: str
    version: str
    code: str
    files: Mapping[str, str]
    plan: str

    @property
    def fingerprint(self) -> str:
        """Of all of it."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode("utf-8")).hexdigest()


@dataclass(frozen=True)
class RunJournal:
    """folder: of the journal. Goes to the actor that owns the reducer as it is."""

    folder: Path
    fingerprint: str
    params: JournalParams

    def reducer(self, stage: ReducerStage, now_s: float) -> DurableReducer:
        """The stage, new and of the mission, with what the folder holds."""
        return DurableReducer(stage, self.folder, self.fingerprint, now_s, self.params)

    def has_been_published(self) -> None:
        """Mark that the map of it is written, so that a new run may take its place."""
        write_text(self.folder / PUBLISHED, "")

    def discard(self) -> None:
        """Remove it; the run has come to its end."""
        shutil.rmtree(self.folder, ignore_errors=True)


def new_record(prepared: PreparedMission, plan: Plan, pace: str) -> RunRecord:
    """Of a run that is to begin."""
    return RunRecord(
        str(prepared.path.absolute()),
        None if prepared.onto is None else str(prepared.onto.path.parent.absolute()),
        pace,
        version("searchlight"),
        code_sha256("pipeline"),
        input_digests(prepared),
        plan_to_json(plan, prepared.problem),
    )


def begin_journal(out: Path, record: RunRecord, params: JournalParams) -> RunJournal:
    """The journal of a new run; of an earlier one nothing is left."""
    folder = (out / UNFINISHED).parent.absolute()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    write_text(folder / _RECORD, json.dumps({"format": _FORMAT} | asdict(record), indent=1) + "\n")
    return RunJournal(folder, record.fingerprint, params)


def read_record(out: Path) -> RunRecord:
    """Of the run that a directory holds unfinished. Raises InputError if there is none of this version."""
    path = out / UNFINISHED
    try:
        document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(out, "no run that was cut off", "the directory of one") from None
    except (OSError, ValueError) as error:
        raise InputError(path, f"an unreadable file ({error})", "that of a run that was cut off") from None
    found = document.pop("format", None) if isinstance(document, dict) else None
    if found != _FORMAT:
        raise InputError(path, repr(found)[:100], f"{_FORMAT!r}: the Searchlight that began the run")
    try:
        return RunRecord(**document)
    except TypeError as error:
        raise InputError(path, f"other fields ({error})", "those of a run that was cut off") from None


def resumed_plan(out: Path, record: RunRecord) -> Plan:
    """The plan that a run began with."""
    return plan_from_json(record.plan, out / UNFINISHED)


def resume_journal(
    out: Path, record: RunRecord, prepared: PreparedMission, params: JournalParams
) -> RunJournal:
    """The journal of a run that goes on. Raises InputError unless the input and the program are what they were."""
    mine = (version("searchlight"), code_sha256("pipeline"))
    if (record.version, record.code) != mine:
        found = f"a run that Searchlight {record.version} began, with other code (sha256 {record.code[:12]})"
        raise InputError(out, found, f"one of this Searchlight, {mine[0]} ({mine[1][:12]})")
    now = input_digests(prepared)
    for path in sorted(record.files.keys() | now.keys()):
        if record.files.get(path) != now.get(path):
            found = "no file" if path not in now else "other content than when the run began"
            found = "a file that the run did not begin with" if path not in record.files else found
            raise InputError(path, found, f"the file as it was, to go on with {out}")
    folder = (out / UNFINISHED).parent.absolute()
    (folder / PUBLISHED).unlink(missing_ok=True)
    return RunJournal(folder, record.fingerprint, params)


def require_finished(out: Path) -> None:
    """Raises InputError if a directory holds a run that was cut off before its map was written."""
    folder = (out / UNFINISHED).parent
    if (out / UNFINISHED).is_file() and not (folder / PUBLISHED).is_file():
        raise InputError(
            out, "a run that was cut off before its map was written", f"--resume {out}, or another --out"
        )


def journal_findings(reducer: DurableReducer) -> tuple[Finding, ...]:
    """What must be known of a reducer's journal: what was cut off, and that it stopped."""
    cut = [
        Finding(
            "warning", "journal_cut", "journal", sentence, mend="nothing: it was sent and looked at again"
        )
        for sentence in reducer.cut
    ]
    if reducer.trouble is None:
        return tuple(cut)
    found = f"the journal stopped ({reducer.trouble}): this run could not have been resumed"
    return (*cut, Finding("warning", "journal_stopped", "journal", found, mend="more space on the disk"))

"""What an operator asks of a mission while it flies: small files in its run directory, answered one by one.

The command writes ``operator/NUMBER.json`` and the run, which looks every round, puts its answer beside it. So who may
write the run directory may command the mission, and nobody else; nothing listens. A file that a request needs is copied
there first: the operator may move the own one afterwards.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, Literal, get_args
from uuid import uuid4

from pipeline.errors import InputError
from pipeline.mission.controller.events import Event, MissionStopped, StreamPaused, StreamStopped
from pipeline.storage.whole_or_nothing import make_folder, write_text

What = Literal["pause", "resume", "stop", "revoke", "area"]
FOLDER = "operator"
#: a request is a few words
_LONGEST_BYTES = 10_000


def ask(run: Path, what: What, stream: str | None, *, file: Path | None = None, within_s: float = 5.0) -> str:
    """Ask the mission whose run directory this is; its answer. Raises InputError if it refuses, or does not answer.

    file: of ``area``, the new search area.
    """
    folder = run / FOLDER
    if not folder.is_dir():
        raise InputError(
            run, "no mission that flies in real time", "the --out of a `run --pace realtime` that goes on"
        )
    request = folder / f"{time.time_ns()}-{uuid4().hex[:8]}.json"
    copy = None if file is None else request.with_name(f"{request.stem}.area{file.suffix}")
    try:
        if file is not None and copy is not None:
            _copy(file, copy)
        write_text(request, json.dumps({"what": what, "stream": stream, "file": copy and copy.name}))
        said = _answer(run, request, within_s)
    finally:
        if copy is not None:
            copy.unlink(missing_ok=True)
    if not said["taken"]:
        raise InputError(file or run, said["text"], said["expected"])
    return str(said["text"])


def _copy(file: Path, copy: Path) -> None:
    try:
        shutil.copyfile(file, copy)
    except OSError as error:
        raise InputError(file, f"a file that cannot be read ({error.strerror})", "a search area") from None


def _answer(run: Path, request: Path, within_s: float) -> dict[str, Any]:
    answer, until = request.with_suffix(".answer"), time.monotonic() + within_s
    while not answer.exists():
        if time.monotonic() > until:
            request.unlink(missing_ok=True)
            raise InputError(run, f"no answer within {within_s:g} s", "a mission that goes on")
        time.sleep(0.05)
    said: dict[str, Any] = json.loads(answer.read_text(encoding="utf-8"))
    answer.unlink(missing_ok=True)
    return said


class OperatorsDesk:
    """The run's side. streams: the names of those that there are. change_area: takes the file of another search area,
    which is gone afterwards; what is to be answered. Raises InputError for one that cannot be used.

    revoked: streams whose drone is not to be heard any more.
    """

    def __init__(self, run: Path, streams: Collection[str], change_area: Callable[[Path], str]) -> None:
        self._folder, self._streams, self._change_area = run / FOLDER, tuple(streams), change_area
        self.revoked: set[str] = set()
        make_folder(self._folder)
        for left in self._folder.iterdir():  # of a run before
            left.unlink(missing_ok=True)

    def events(self) -> list[Event]:
        """What was asked since the last call, in its order; each is answered."""
        return [event for path in sorted(self._folder.glob("*.json")) if (event := self._taken(path))]

    def close(self) -> None:
        """The mission is over: whoever asks now is told so."""
        for left in self._folder.iterdir():
            left.unlink(missing_ok=True)
        self._folder.rmdir()

    def _taken(self, path: Path) -> Event | None:
        try:
            event, text = self._event_of(path)
            answer = {"taken": True, "text": text}
        except InputError as error:
            event, answer = None, {"taken": False, "text": error.found, "expected": error.expected}
        path.unlink(missing_ok=True)
        write_text(path.with_suffix(".answer"), json.dumps(answer))
        return event

    def _event_of(self, path: Path) -> tuple[Event | None, str]:
        what, stream, file = _request(path)
        if what == "area":
            if file is None or Path(file).name != file or (self._folder / file).is_symlink():
                raise InputError(path, f"the file {file!r}", "the name of one beside the request")
            return None, self._change_area(self._folder / file)
        if stream is None:
            if what != "stop":
                raise InputError(path, f"{what} without a stream", "the name of a stream")
            return MissionStopped(), "the mission ends; what was sent is still looked at"
        if stream not in self._streams:
            raise InputError(path, f"the stream {stream!r}", f"one of {', '.join(self._streams)}")
        if what == "stop":
            return StreamStopped(stream), f"{stream} ends; what was sent is still looked at"
        if what == "revoke":
            self.revoked.add(stream)
            return StreamStopped(stream), f"{stream} is heard no more; what came before stays in the map"
        if what == "pause":
            return StreamPaused(stream, True), f"{stream} is looked at no more, until it is resumed"
        return StreamPaused(stream, False), f"{stream} is planned for again"


def _request(path: Path) -> tuple[str, str | None, str | None]:
    right = 'an object {"what": "pause", "resume", "stop", "revoke" or "area", "stream": its name or null}'
    try:
        if path.is_symlink() or path.stat().st_size > _LONGEST_BYTES:
            raise ValueError
        said = json.loads(path.read_text(encoding="utf-8"))
        what, stream, file = said["what"], said["stream"], said.get("file")
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise InputError(path, "a request that cannot be read", right) from None
    if what not in get_args(What) or not all(one is None or isinstance(one, str) for one in (stream, file)):
        raise InputError(path, f"the request {what!r} of {stream!r}", right)
    return what, stream, file

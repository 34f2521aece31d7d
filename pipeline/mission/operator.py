"""What an operator asks of a mission while it flies: small files in its run directory, answered one by one.

The command writes ``operator/NUMBER.json`` and the run, which looks every round, puts its answer beside it. So who may
write the run directory may command the mission, and nobody else; nothing listens.
"""

from __future__ import annotations

import json
import time
from collections.abc import Collection
from pathlib import Path
from typing import Literal, get_args
from uuid import uuid4

from pipeline.errors import InputError
from pipeline.mission.controller.events import Event, MissionStopped, StreamPaused, StreamStopped
from pipeline.storage.whole_or_nothing import make_folder, write_text

What = Literal["pause", "resume", "stop"]
FOLDER = "operator"
#: a request is a few words
_LONGEST_BYTES = 10_000


def ask(run: Path, what: What, stream: str | None, *, within_s: float = 5.0) -> str:
    """Ask the mission whose run directory this is; its answer. Raises InputError if it refuses, or does not answer."""
    folder = run / FOLDER
    if not folder.is_dir():
        raise InputError(
            run, "no mission that flies in real time", "the --out of a `run --pace realtime` that goes on"
        )
    request = folder / f"{time.time_ns()}-{uuid4().hex[:8]}.json"
    write_text(request, json.dumps({"what": what, "stream": stream}))
    answer, until = request.with_suffix(".answer"), time.monotonic() + within_s
    while not answer.exists():
        if time.monotonic() > until:
            request.unlink(missing_ok=True)
            raise InputError(run, f"no answer within {within_s:g} s", "a mission that goes on")
        time.sleep(0.05)
    said = json.loads(answer.read_text(encoding="utf-8"))
    answer.unlink(missing_ok=True)
    if not said["taken"]:
        raise InputError(run, said["text"], said["expected"])
    return str(said["text"])


class OperatorsDesk:
    """The run's side. streams: the names of those that there are."""

    def __init__(self, run: Path, streams: Collection[str]) -> None:
        self._folder, self._streams = run / FOLDER, tuple(streams)
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

    def _event_of(self, path: Path) -> tuple[Event, str]:
        what, stream = _request(path)
        if stream is None:
            if what != "stop":
                raise InputError(path, f"{what} without a stream", "the name of a stream")
            return MissionStopped(), "the mission ends; what was sent is still looked at"
        if stream not in self._streams:
            raise InputError(path, f"the stream {stream!r}", f"one of {', '.join(self._streams)}")
        if what == "stop":
            return StreamStopped(stream), f"{stream} ends; what was sent is still looked at"
        if what == "pause":
            return StreamPaused(stream, True), f"{stream} is looked at no more, until it is resumed"
        return StreamPaused(stream, False), f"{stream} is planned for again"


def _request(path: Path) -> tuple[str, str | None]:
    right = 'an object {"what": "pause", "resume" or "stop", "stream": its name or null}'
    try:
        if path.is_symlink() or path.stat().st_size > _LONGEST_BYTES:
            raise ValueError
        said = json.loads(path.read_text(encoding="utf-8"))
        what, stream = said["what"], said["stream"]
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(path, "a request that cannot be read", right) from None
    if what not in get_args(What) or not (stream is None or isinstance(stream, str)):
        raise InputError(path, f"the request {what!r} of {stream!r}", right)
    return what, stream

"""SIGINT, SIGTERM and SIGHUP of a run: the first ends it in good order, the second at once."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

from pipeline.errors import StoppedError
from pipeline.leftovers import sweep
from pipeline.mission.stopping import Stop

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_NAMES = {int(number): number.name for number in SIGNALS}
#: ours, the newest last
_HANDLERS: list[Callable[[int, FrameType | None], None]] = []


@contextmanager
def stopped_by_signals(stop: Stop) -> Iterator[None]:
    """Within it a first signal asks ``stop``, or raises StoppedError if nobody waits for that; a second one ends the
    process at once, with all its children, whatever the main thread is doing.

    Only the main thread can call it. A library that takes the signals for itself is undone by ``retake_signals``.
    """
    former = {number: signal.getsignal(number) for number in SIGNALS}
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    former_wakeup = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    # by the C handler, at the moment of the signal: the main thread may be in a solver for half a minute
    threading.Thread(target=_watch, args=(reader,), daemon=True, name="signals").start()
    _HANDLERS.append(lambda number, _: _first(stop, number))
    retake_signals()
    try:
        yield
    finally:
        _HANDLERS.pop()
        for number, handler in former.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(former_wakeup)
        os.close(writer)


def retake_signals() -> None:
    """Put our handlers back, after a library such as Ray has put its own."""
    for number in SIGNALS:
        if _HANDLERS:
            signal.signal(number, _HANDLERS[-1])


def _first(stop: Stop, number: int) -> None:
    if number == signal.SIGHUP:
        _leave_the_terminal()
    if stop.reason is not None:
        return
    stop.ask(f"stopped by {_NAMES[number]}")
    if not stop.awaited:
        raise StoppedError(_NAMES[number], number)


def _leave_the_terminal() -> None:
    """It is gone: what is said from now on is only in the log, and must not fail."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            if stream.isatty():
                with Path(os.devnull).open("wb") as nowhere:
                    os.dup2(nowhere.fileno(), stream.fileno())


def _watch(reader: int) -> None:
    seen = 0
    with os.fdopen(reader, "rb", buffering=0) as pipe:
        while data := pipe.read(1):
            seen += data[0] in _NAMES
            if seen == 2:
                end_at_once(128 + data[0])


def end_at_once(code: int) -> None:
    """End the process and all its children, and remove what they would leave behind."""
    end_children()
    sweep()
    os._exit(code)


def end_children() -> None:
    """Kill every process that this one has started, and those that they have started."""
    # children first, until there are none: one may start another while we look
    for _ in range(10):
        found = children(os.getpid())
        if not found:
            return
        for pid in found:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        for pid in found:
            with suppress(ChildProcessError):
                os.waitpid(pid, 0)


def children(pid: int) -> list[int]:
    """All that a process has started, and what they have, while their parents live; none where there is no /proc."""
    parents: dict[int, list[int]] = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            # the name, in brackets, may hold blanks and brackets itself
            state, parent = entry.read_text().rpartition(")")[2].split()[:2]
            if state != "Z":
                parents.setdefault(int(parent), []).append(int(entry.parent.name))
    found, waiting = [], [pid]
    while waiting:
        below = parents.get(waiting.pop(), [])
        found += below
        waiting += below
    return found

"""What the command line says: lines and progress bars, on standard error."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TaskProgressColumn, TextColumn, TimeRemainingColumn

console = Console(stderr=True)


def say(line: str) -> None:
    """One line, as it is; nowhere, if the terminal is gone."""
    with suppress(OSError):
        console.print(line, soft_wrap=True, highlight=False, markup=False)


@contextmanager
def progress_bars(unit: str | None) -> Iterator[Callable[..., None]]:
    """A function update(name, done, total, note="") that draws one bar for each name.

    unit: of done and total; None: they are told as a share. What was done before the first call does not make
    the rest look fast.
    """
    count = TextColumn("{task.completed:.0f}/{task.total:.0f} " + (unit or ""))
    bars = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn() if unit is None else count,
        TextColumn("{task.fields[note]}"),
        TimeRemainingColumn(),
        console=console,
    )
    tasks: dict[str, TaskID] = {}

    def update(name: str, done: int, total: int, note: str = "") -> None:
        if name not in tasks:
            tasks[name] = bars.add_task(name, total=total, completed=done, note="")
        bars.update(tasks[name], completed=done, total=total, note=note)

    with bars:
        yield update

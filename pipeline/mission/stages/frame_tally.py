"""Frames of one stream at the reducer, each once, counted as they come: nobody goes through them to know how many."""

from __future__ import annotations

from collections import Counter


class FrameTally:
    """looked: frames that at least one detector has looked at. nobody: the others of which it is known why; index ->
    reason, the last one said. reasons: how many of these there are for each.
    """

    def __init__(self) -> None:
        self.looked: set[int] = set()
        self.nobody: dict[int, str] = {}
        self.reasons: Counter[str] = Counter()

    def look(self, index: int) -> None:
        """A detector has looked at a frame: whatever was said of it before counts no more."""
        self.looked.add(index)
        self._forget(index)

    def drop(self, index: int, reason: str) -> None:
        """A detector will not look at a frame."""
        if index not in self.looked:
            self._forget(index)
            self.nobody[index] = reason
            self.reasons[reason] += 1

    def _forget(self, index: int) -> None:
        reason = self.nobody.pop(index, None)
        if reason is not None:
            self.reasons[reason] -= 1

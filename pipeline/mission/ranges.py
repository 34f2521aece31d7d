"""A set of whole numbers that are mostly without gaps."""

from __future__ import annotations

import bisect
from collections.abc import Iterable


class Ranges:
    """Numbers from 0 on, kept as ranges: as small as it has gaps, however many numbers there are."""

    def __init__(self, ranges: Iterable[tuple[int, int]] = ()) -> None:
        """ranges: disjoint and in order, each from its first number to one past its last."""
        self._starts: list[int] = []
        self._ends: list[int] = []
        for start, end in ranges:
            self._starts.append(start)
            self._ends.append(end)

    def add(self, number: int) -> bool:
        """Take a number; False if it was there."""
        at = bisect.bisect_right(self._starts, number)
        if at and number < self._ends[at - 1]:
            return False
        joins_before = at > 0 and self._ends[at - 1] == number
        joins_after = at < len(self._starts) and self._starts[at] == number + 1
        if joins_before and joins_after:
            self._ends[at - 1] = self._ends.pop(at)
            self._starts.pop(at)
        elif joins_before:
            self._ends[at - 1] += 1
        elif joins_after:
            self._starts[at] -= 1
        else:
            self._starts.insert(at, number)
            self._ends.insert(at, number + 1)
        return True

    def __contains__(self, number: int) -> bool:
        at = bisect.bisect_right(self._starts, number)
        return at > 0 and number < self._ends[at - 1]

    def __len__(self) -> int:
        return sum(self._ends) - sum(self._starts)

    @property
    def ranges(self) -> tuple[tuple[int, int], ...]:
        """As __init__ takes them."""
        return tuple(zip(self._starts, self._ends, strict=True))

    @property
    def end(self) -> int:
        """One past the greatest number; 0 if there is none."""
        return self._ends[-1] if self._ends else 0

    @property
    def gaps(self) -> tuple[tuple[int, int], ...]:
        """What is missing between 0 and end, as ranges."""
        edges = [0, *(edge for both in zip(self._starts, self._ends, strict=True) for edge in both)]
        gaps = zip(edges[::2], edges[1::2], strict=False)
        return tuple((start, end) for start, end in gaps if start < end)

"""What one stream can do: a multiset of (kind, level) whose periods are a covering pattern."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from pipeline.allocation.aggregation import Aggregation, StreamClass

Choice = tuple[int, int]
"""Number of a kind, number of a level."""


@dataclass(frozen=True)
class Configuration:
    """A column of the master problem.

    stream_class: its number. choices: ascending. value: in OBJECTIVE_RESOLUTION, penalties off. kept:
    substreams of the running plan that it goes on with.
    """

    stream_class: int
    choices: tuple[Choice, ...]
    value: int
    kept: int

    @property
    def kinds(self) -> tuple[int, ...]:
        """The kinds used, once for each use."""
        return tuple(kind for kind, _ in self.choices)


def configuration(aggregation: Aggregation, number: int, choices: tuple[Choice, ...]) -> Configuration:
    """The configuration of a stream class that consists of these choices."""
    stream_class: StreamClass = aggregation.classes[number]
    sites = {aggregation.kinds[k].site for k, _ in choices}
    gain = sum(int(stream_class.value[k, b]) for k, b in choices)
    kept = sum(min(n, int(stream_class.kept[choice])) for choice, n in Counter(choices).items())
    return Configuration(number, tuple(sorted(choices)), gain - aggregation.penalty * len(sites), kept)

"""Results that are not known to be safe: they are sent again to a reducer that has lost them."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass

from pipeline.messages import Message
from pipeline.mission.durable_reducer import Acknowledgement

Numbered = tuple[str, str, int, int]


@dataclass(frozen=True)
class KeptParams:
    """results: that are kept; beyond that the oldest are given up and counted."""

    results: int = 20_000

    def __post_init__(self) -> None:
        if self.results < 1:
            raise ValueError(f"{self}; expected at least one result")


class KeptResults:
    """In the order in which they were sent. given_up: so many were forgotten before anybody said that they are safe."""

    def __init__(self, params: KeptParams | None = None) -> None:
        self.given_up = 0
        self._params = params or KeptParams()
        self._kept: OrderedDict[Numbered, Message] = OrderedDict()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._kept)

    def keep(self, result: Message) -> None:
        """Keep a result until it is acknowledged."""
        with self._lock:
            self._kept[_numbered(result)] = result
            if len(self._kept) > self._params.results:
                self._kept.popitem(last=False)
                self.given_up += 1

    def acknowledge(self, acknowledgements: Iterable[Acknowledgement]) -> None:
        """Forget what is safe."""
        safe = {(a.stream, a.detector, a.epoch): a for a in acknowledgements}
        with self._lock:
            gone = [key for key in self._kept if key[:3] in safe and key[3] in safe[key[:3]]]
            for key in gone:
                del self._kept[key]

    def forget(self, stream: str, detector: str, epoch: int) -> None:
        """Forget all of a substream that is closed: nobody would take it."""
        with self._lock:
            for key in [key for key in self._kept if key[:3] == (stream, detector, epoch)]:
                del self._kept[key]

    @property
    def oldest(self) -> Message | None:
        """The result that has waited longest to be safe."""
        with self._lock:
            return next(iter(self._kept.values()), None)

    def again(self) -> list[Message]:
        """All that is not safe, in its order."""
        with self._lock:
            return list(self._kept.values())


def _numbered(result: Message) -> Numbered:
    return result.stream, result.detector, result.epoch, result.sequence

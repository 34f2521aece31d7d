"""Which streams look from one place: two cameras of one aircraft see a person from the same side."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pipeline.messages import FloatArray

#: cameras that are this near to each other, within this time, are on one aircraft
_ONE_AIRCRAFT_M, _ONE_TIME_NS = 3.0, 1_000_000_000
#: numbers are bytes; more streams than that share them, and their looks count too little rather than too much
_MOST = 255


class Viewpoints:
    """Numbers of viewpoints, 1..255. newest: of each stream its newest frame's time and camera position."""

    def __init__(self, streams: Iterable[str]) -> None:
        self._number = {name: k % _MOST + 1 for k, name in enumerate(sorted(streams))}
        self.newest: dict[str, tuple[int, float, float, float]] = {}

    def of_frame(self, stream: str, time_ns: int, position_enu: FloatArray) -> int:
        """The number of a frame's viewpoint: the least of the streams that are filmed from the same place now."""
        east, north, up = position_enu.tolist()
        self.newest[stream] = time_ns, east, north, up
        here = np.array([east, north, up])
        numbers = [
            self._number[other]
            for other, (other_ns, *place) in self.newest.items()
            if abs(time_ns - other_ns) <= _ONE_TIME_NS
            and float(np.linalg.norm(here - np.array(place))) <= _ONE_AIRCRAFT_M
        ]
        return min(numbers)

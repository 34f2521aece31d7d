"""Puts results that come late into their place: the fuser goes back, and applies what it knew since once more.

OctoMap's clamping makes the order of results matter. So the results of the last minutes are kept in a short log, and
beside it what the fuser was at a few times of these minutes: of its maps only the tiles that were written to since. A
result that comes after later ones were applied is put into the log at its place; at the next ``settle`` the fuser goes
back to the newest of those times that lies before it, and applies the log from there. Any order of arrival within the
window gives the same map, byte for byte. A whole outage is one settling: late results wait for it together, and so
does what comes meanwhile.
"""

from __future__ import annotations

import bisect
from collections import Counter
from dataclasses import dataclass, field

from pipeline.fusion.fuser import Fuser
from pipeline.fusion.fuser_state import FuserState, restore, state_of
from pipeline.fusion.tiles import Before
from pipeline.messages import Detections

Order = tuple[int, str, str]
#: a place in the log; the number is above 0 for results that were applied out of their place, after the one there
Key = tuple[Order, int]

#: before every result
_BEGIN: Key = ((-1, "", ""), 0)
#: the fuser is remembered at so many times of a window
_TIMES = 4


@dataclass(frozen=True)
class ReplayParams:
    """window_ns: results that come later than that, against the newest, by the time of capture, stay out of their
    place; 0: nothing is kept. most_results: in the log; beyond it the window is shorter. From one result on.
    """

    window_ns: int = 0
    most_results: int = 20_000


@dataclass(frozen=True, eq=False)
class _Moment:
    """What the fuser was. key: of the last result that it had applied. since_ns: capture time of the next one.

    maps: by class, the tiles that were written to since, as they were.
    """

    key: Key
    since_ns: int
    state: FuserState
    maps: dict[str, Before] = field(default_factory=dict)


@dataclass(frozen=True)
class Log:
    """What a new fuser needs beside the maps ``before`` to go on. entries: the results since, and their numbers (see
    ``Key``). latest_ns: newest capture time. base: the place in the order before the entries.
    """

    state: FuserState
    base: Key
    entries: tuple[tuple[Order, int, Detections], ...]
    latest_ns: int


class Replay:
    """fuser: not to be read before ``settle``. late: results that came after later ones were applied, by stream and
    detector; out_of_place: those of them that came too late to be put in their place.
    """

    def __init__(self, fuser: Fuser, params: ReplayParams) -> None:
        self.fuser, self._params = fuser, params
        self.late: Counter[tuple[str, str]] = Counter()
        self.out_of_place: Counter[tuple[str, str]] = Counter()
        self._keys: list[Key] = []
        self._log: list[Detections] = []
        self._moments: list[_Moment] = []
        self._base: Key = _BEGIN
        self._latest_ns = -1
        self._stale: Key | None = None

    def apply(self, result: Detections) -> None:
        """Take one result: at once if it is the last in the order, else at the next ``settle``."""
        last = self._keys[-1] if self._keys else self._base
        key = (result.order, 0)
        if key < last:
            key = self._place_of_late(result, last)
        self._latest_ns = max(self._latest_ns, result.time_ns)
        if not self._params.window_ns:
            self._base = key
            self.fuser.apply(result)
            return
        at = bisect.bisect_left(self._keys, key)
        self._keys.insert(at, key)
        self._log.insert(at, result)
        if self._stale is None and at == len(self._keys) - 1:
            self._apply_entry(at)
            self._forget()
        else:
            self._stale = key if self._stale is None else min(key, self._stale)
            if len(self._log) > self._params.most_results:
                self.settle()

    def settle(self) -> None:
        """Let the fuser have applied all that was taken, in the order."""
        if self._stale is None:
            return
        while self._moments and self._moments[-1].key >= self._stale:
            self._go_back_before_last_moment()
        self._stale = None
        begin = self._moments[-1].key if self._moments else self._base
        if self._moments:
            self._go_back_to_last_moment()
        for at in range(bisect.bisect_right(self._keys, begin), len(self._keys)):
            self._apply_entry(at)
        self._forget()

    @property
    def log(self) -> Log:
        """What ``go_on`` takes."""
        entries = tuple((*key, result) for key, result in zip(self._keys, self._log, strict=True))
        state = self._moments[0].state if self._moments else state_of(self.fuser)
        return Log(state, self._base, entries, self._latest_ns)

    def before(self, name: str) -> Before:
        """The tiles of a class's map that differ from those before the log, as they were."""
        tiles: Before = {}
        for moment in reversed(self._moments):
            tiles |= moment.maps[name]
        return tiles

    def go_on(self, log: Log) -> None:
        """Go on from a log, over maps that are as before it."""
        restore(self.fuser, log.state)
        self._moments.clear()
        self._keep_into(None)
        self._base, self._latest_ns = log.base, log.latest_ns
        self._keys = [(order, number) for order, number, _ in log.entries]
        self._log = [result for *_, result in log.entries]
        self._stale = self._keys[0] if self._keys else None

    def _place_of_late(self, result: Detections, last: Key) -> Key:
        """Where a late result goes: to its place, or, if that is forgotten, after all that came before it."""
        substream, key = (result.stream, result.detector), (result.order, 0)
        self.late[substream] += 1
        if key > self._base and result.time_ns >= self._latest_ns - self._params.window_ns:
            return key
        self.out_of_place[substream] += 1
        return last[0], last[1] + 1

    def _apply_entry(self, at: int) -> None:
        result = self._log[at]
        newest = self._moments[-1] if self._moments else None
        since = bisect.bisect_right(self._keys, newest.key) if newest else 0
        if (
            newest is None
            or result.time_ns - newest.since_ns > self._params.window_ns / _TIMES
            or at - since >= max(1, self._params.most_results // _TIMES)
        ):
            self._remember(self._keys[at - 1] if at else self._base, result.time_ns)
        self.fuser.apply(result)

    def _remember(self, key: Key, since_ns: int) -> None:
        moment = _Moment(key, since_ns, state_of(self.fuser), {name: {} for name in self.fuser.maps})
        self._moments.append(moment)
        self._keep_into(moment)

    def _keep_into(self, moment: _Moment | None) -> None:
        for name, voxel_map in self.fuser.maps.items():
            voxel_map.tiles.before = None if moment is None else moment.maps[name]

    def _go_back_to_last_moment(self) -> None:
        moment = self._moments[-1]
        for name, voxel_map in self.fuser.maps.items():
            voxel_map.tiles.put_back(moment.maps[name])
        restore(self.fuser, moment.state)
        self._keep_into(moment)

    def _go_back_before_last_moment(self) -> None:
        moment = self._moments.pop()
        for name, voxel_map in self.fuser.maps.items():
            voxel_map.tiles.put_back(moment.maps[name])

    def _forget(self) -> None:
        """What is older than the window, or more than the log may hold."""
        while len(self._moments) > 1:
            key = self._moments[1].key
            is_needed = key[0][0] >= self._latest_ns - self._params.window_ns
            if is_needed and len(self._log) <= self._params.most_results:
                return
            cut = bisect.bisect_right(self._keys, key)
            del self._keys[:cut], self._log[:cut], self._moments[0]
            self._base = key

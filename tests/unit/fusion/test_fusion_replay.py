"""What comes late is put in its place within the window; what comes later still is applied and counted."""

import numpy as np
import pytest

from pipeline.fusion.replay import Replay, ReplayParams
from pipeline.fusion.tiles import TILE, Tiles
from pipeline.fusion.voxel_map import VOXEL


class Remembers:
    """In place of a fuser: its one tile holds a hash of the order in which it was told."""

    def __init__(self):
        self.tiles = Tiles((1, 1), VOXEL)
        self.maps = {"person": self}
        self.looks, self.refused, self.unplaced, self.sizes, self.last_ns = [], {}, {}, {}, {}
        self.viewpoints, self.newest, self.applied = self, {}, 0

    def apply(self, result):
        self.tiles.keep((0, 0), (0, 0))
        self.tiles.touched[0, 0] = True
        cell = self.tiles.tile(0, 0)[0, :1]
        cell["last_seen_ns"] = (cell["last_seen_ns"] * 31 + result.time_ns) % 1_000_003
        self.looks.append(result.time_ns)
        self.applied += 1


class Result:
    def __init__(self, time_ns, stream="a"):
        self.time_ns, self.stream, self.detector = time_ns, stream, "d"
        self.order = time_ns, stream, "d"


def told(times, window_ns, most=1000, settle_each=False):
    replay = Replay(Remembers(), ReplayParams(window_ns, most))
    for time_ns in times:
        replay.apply(Result(time_ns))
        if settle_each:
            replay.settle()
    replay.settle()
    return replay


def known(replay):
    return replay.fuser.looks, replay.fuser.tiles.cells.tobytes()


@pytest.mark.parametrize("settle_each", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_any_order_within_the_window_is_the_order(seed, settle_each):
    times = np.arange(1, 120)
    late = times + np.random.default_rng(seed).integers(0, 40, len(times))
    got = told(times[np.argsort(late, kind="stable")].tolist(), 40, settle_each=settle_each)
    assert known(got) == known(told(times.tolist(), 0))
    assert not got.out_of_place
    assert got.late["a", "d"] > 10


def test_what_comes_later_than_the_window_is_applied_last_and_counted():
    got = told([1, 2, 100, 50, 101], 60)
    assert got.fuser.looks == [1, 2, 50, 100, 101]
    got = told([1, 2, 100, 30, 101, 90], 60)
    assert got.fuser.looks == [1, 2, 90, 100, 30, 101]
    assert (got.late.total(), got.out_of_place.total()) == (2, 1)


def test_without_a_window_nothing_is_kept_and_what_is_late_stays_out_of_its_place():
    got = told([1, 5, 3, 4, 6], 0)
    assert got.fuser.looks == [1, 5, 3, 4, 6]
    assert (got.late.total(), got.out_of_place.total()) == (2, 2)
    assert not got.log.entries
    assert got.fuser.tiles.before is None


def test_a_whole_outage_is_one_going_back():
    times = [*range(200, 400), *range(1, 200)]
    got = told(times, 1000)
    assert got.fuser.looks == sorted(times)
    assert got.fuser.applied == 200 + 399


def test_a_slightly_late_result_does_not_cost_the_whole_window():
    got = told([*(t for t in range(1, 401) if t != 395), 395], 400)
    assert got.fuser.looks == list(range(1, 401))
    assert got.fuser.applied < 400 + 110


@pytest.mark.parametrize("most", [1, 7, 100])
def test_the_log_is_bounded_whatever_comes(most):
    replay = Replay(Remembers(), ReplayParams(10_000, most))
    for k, time_ns in enumerate(np.random.default_rng(3).permutation(2000).tolist()):
        replay.apply(Result(time_ns))
        assert len(replay.log.entries) <= most + most // 4 + 1, k
    replay.settle()
    assert sorted(replay.fuser.looks) == list(range(2000))


def test_the_tiles_before_the_log_are_as_they_were_then():
    got, early = told(range(1, 400), 100), None
    early = told(range(1, 1 + 399 - len(got.log.entries)), 0)
    before = got.before("person")
    assert before[0, 0].tobytes() == early.fuser.tiles.tile(0, 0).tobytes()
    assert before[0, 0].shape == (TILE, TILE)

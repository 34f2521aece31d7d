import pickle

import numpy as np
import pytest

from pipeline.fusion.tiles import TILE, Tiles

RECORD = np.dtype([("a", "<f4"), ("b", "<i4")])
SHAPE = (2 * TILE + 10, 3 * TILE - 5)


def _write(tiles, rows, columns, values):
    rows, columns = np.array(rows), np.array(columns)
    tiles.touch(rows, columns)
    tiles.cells["b"][tiles.flat(rows, columns)] = values


@pytest.fixture(params=["memory", "disk"])
def tiles(request, tmp_path):
    return Tiles(SHAPE, RECORD, None if request.param == "memory" else tmp_path)


def test_what_is_written_is_read_at_its_place_and_the_rest_is_zero(tiles):
    rng = np.random.default_rng(0)
    expected = np.zeros(SHAPE, dtype=np.int32)
    rows, columns = rng.integers(0, SHAPE[0], 500), rng.integers(0, SHAPE[1], 500)
    expected[rows, columns] = np.arange(500)
    _write(tiles, rows, columns, expected[rows, columns])
    np.testing.assert_array_equal(tiles.part("b", (slice(None), slice(None))), expected)
    window = (slice(200, 300), slice(255, 257))
    np.testing.assert_array_equal(tiles.part("b", window), expected[window])
    assert not tiles.part("a", window).any()


def test_the_cells_of_a_tile_lie_together_row_by_row(tiles):
    _write(tiles, [TILE + 3], [2 * TILE + 4], [7])
    assert tiles.tile(1, 2)["b"][3, 4] == 7
    assert list(tiles.touched_tiles()) == [(1, 2)]
    assert tiles.window(1, 2) == (slice(TILE, 2 * TILE), slice(2 * TILE, SHAPE[1]))


def test_the_touched_window_holds_all_touched_tiles(tiles):
    assert tiles.touched_window() == (slice(0, 0), slice(0, 0))
    _write(tiles, [0, 2 * TILE], [TILE, 0], [1, 2])
    assert tiles.touched_window() == (slice(0, SHAPE[0]), slice(0, 2 * TILE))


def test_evicted_tiles_are_still_there(tmp_path):
    tiles = Tiles(SHAPE, RECORD, tmp_path)
    _write(tiles, [5, 300], [6, 700], [1, 2])
    tiles.evict()
    assert tiles.part("b", (slice(5, 6), slice(6, 7))) == [[1]]
    assert tiles.part("b", (slice(300, 301), slice(700, 701))) == [[2]]


def test_nothing_is_left_in_the_folder(tmp_path):
    tiles = Tiles(SHAPE, RECORD, tmp_path)
    _write(tiles, [5], [6], [1])
    assert not list(tmp_path.iterdir())


def test_a_cleared_grid_is_zero(tiles):
    _write(tiles, [5], [6], [1])
    tiles.clear()
    assert not tiles.cells["b"].any()
    assert not tiles.touched.any()


def test_a_grid_larger_than_memory_takes_what_is_touched(tmp_path):
    tiles = Tiles((200_000, 200_000), RECORD, tmp_path)  # 320 GB
    _write(tiles, [199_999], [199_999], [9])
    assert tiles.part("b", (slice(199_998, 200_000), slice(199_998, 200_000))).tolist() == [[0, 0], [0, 9]]


def test_only_touched_tiles_travel(tiles):
    _write(tiles, [5, 300], [6, 700], [1, 2])
    data = pickle.dumps(tiles)
    arrived = pickle.loads(data)
    assert len(data) < 2.1 * TILE * TILE * RECORD.itemsize
    assert arrived.cells.tobytes() == tiles.cells.tobytes()
    assert list(arrived.touched_tiles()) == list(tiles.touched_tiles())

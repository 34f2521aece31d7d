"""Cells of a large grid in square tiles, of which only those touched take up memory or disk."""

from __future__ import annotations

import mmap
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: log2 of the cells on the side of a tile
TILE_BITS = 8
#: cells on the side of a tile
TILE = 1 << TILE_BITS

Window = tuple[slice, slice]
#: records (TILE, TILE) by tile row and column
Before = dict[tuple[int, int], NDArray[Any] | None]


def tile_shape(shape: tuple[int, int]) -> tuple[int, int]:
    """Tile rows and tile columns of a grid of so many rows and columns."""
    return -(-shape[0] // TILE), -(-shape[1] // TILE)


class Tiles:
    """A grid (rows, columns) of records that are zero until they are written.

    cells: (tiles * TILE * TILE,), tile by tile and row by row within each. touched: bool (tile rows, tile
    columns), which tiles may hold anything but zeros; whoever writes to cells sets it. owned: bool
    (tile rows, tile columns), which may be written to. before: where ``keep`` puts tiles as they are before they
    are written to, None for one that holds only zeros; None where nobody wants them. The system gives a tile memory
    when it is first written. With a folder the cells are a sparse file there, without a name, so that the system can
    move tiles to disk and nothing is left behind.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        dtype: np.dtype[Any],
        folder: Path | None = None,
        owned: NDArray[np.bool_] | None = None,
    ) -> None:
        self.shape = shape
        self.touched = np.zeros(tile_shape(shape), dtype=np.bool_)
        self.owned = np.ones_like(self.touched) if owned is None else owned
        self.before: Before | None = None
        size = self.touched.size * TILE * TILE
        self._file: mmap.mmap | None = None
        if folder is None:
            self.cells: NDArray[Any] = np.zeros(size, dtype=dtype)
        else:
            with tempfile.TemporaryFile(dir=folder) as file:
                file.truncate(max(size, 1) * dtype.itemsize)
                self._file = mmap.mmap(file.fileno(), 0)
            self.cells = np.frombuffer(self._file, dtype=dtype, count=size)

    def __getstate__(self) -> dict[str, Any]:
        """Only the touched tiles travel between processes; they arrive in memory."""
        tiles = [(tile, self.tile(*tile).tobytes()) for tile in self.touched_tiles()]
        return {"shape": self.shape, "dtype": self.cells.dtype, "owned": self.owned, "tiles": tiles}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["shape"], state["dtype"], None, state["owned"])  # type: ignore[misc]
        for tile, data in state["tiles"]:
            self.tile(*tile)[:] = np.frombuffer(data, dtype=state["dtype"]).reshape(TILE, TILE)
            self.touched[tile] = True

    def flat(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Where the cells (N,) lie in ``cells``."""
        tile = (rows >> TILE_BITS) * self.touched.shape[1] + (columns >> TILE_BITS)
        return (tile << 2 * TILE_BITS) + ((rows & (TILE - 1)) << TILE_BITS) + (columns & (TILE - 1))

    def owns(self, row: int, column: int) -> bool:
        """Whether a cell is in a tile that is kept here."""
        return bool(self.owned[row >> TILE_BITS, column >> TILE_BITS])

    def touch(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> None:
        """Note that the cells (N,) are written to."""
        self.touched[rows >> TILE_BITS, columns >> TILE_BITS] = True

    def keep(self, low: tuple[int, int], high: tuple[int, int]) -> None:
        """Before cells are written to: keep the tiles of the rows and columns from low to high, both included."""
        if self.before is None:
            return
        for row in range(low[0] >> TILE_BITS, (high[0] >> TILE_BITS) + 1):
            for column in range(low[1] >> TILE_BITS, (high[1] >> TILE_BITS) + 1):
                if self.owned[row, column] and (row, column) not in self.before:
                    known = self.touched[row, column]
                    self.before[row, column] = self.tile(row, column).copy() if known else None

    def put_back(self, before: Before) -> None:
        """Let tiles be what they were."""
        for (row, column), records in before.items():
            self.touched[row, column] = records is not None
            self.tile(row, column)[:] = 0 if records is None else records

    def tile(self, tile_row: int, tile_column: int) -> NDArray[Any]:
        """The records (TILE, TILE) of one tile; a view."""
        first = (tile_row * self.touched.shape[1] + tile_column) * TILE * TILE
        return self.cells[first : first + TILE * TILE].reshape(TILE, TILE)

    def touched_tiles(self) -> Iterator[tuple[int, int]]:
        """Tile row and column of every touched tile, row by row."""
        for tile_row, tile_column in np.argwhere(self.touched):
            yield int(tile_row), int(tile_column)

    def window(self, tile_row: int, tile_column: int) -> Window:
        """The cells of a tile that are on the grid."""
        (rows, columns), (row, column) = self.shape, (tile_row * TILE, tile_column * TILE)
        return slice(row, min(row + TILE, rows)), slice(column, min(column + TILE, columns))

    def touched_window(self) -> Window:
        """The least part of the grid that holds all touched tiles; empty if there is none."""
        if not self.touched.any():
            return slice(0, 0), slice(0, 0)
        first, last = np.argwhere(self.touched).min(axis=0), np.argwhere(self.touched).max(axis=0)
        low, high = self.window(int(first[0]), int(first[1])), self.window(int(last[0]), int(last[1]))
        return slice(low[0].start, high[0].stop), slice(low[1].start, high[1].stop)

    def part(self, field: str, window: Window) -> NDArray[Any]:
        """One field of the cells in a window, (rows, columns); a copy."""
        rows, columns = (range(*side.indices(n)) for side, n in zip(window, self.shape, strict=True))
        result = np.zeros((len(rows), len(columns)), dtype=self.cells.dtype[field])
        for tile_row in _tiles(rows):
            for tile_column in _tiles(columns):
                if self.touched[tile_row, tile_column]:
                    mine, its = _overlap(rows, tile_row), _overlap(columns, tile_column)
                    result[mine[0], its[0]] = self.tile(tile_row, tile_column)[field][mine[1], its[1]]
        return result

    def clear(self) -> None:
        """Forget everything."""
        for tile in self.touched_tiles():
            self.tile(*tile)[:] = 0
        self.touched[:] = False

    def evict(self) -> None:
        """Give the memory of all tiles back to the system; their records stay, on disk. Needs a folder."""
        if self._file is not None:
            self._file.flush()
            self._file.madvise(mmap.MADV_DONTNEED)


def _tiles(cells: range) -> range:
    return range(cells.start >> TILE_BITS, -(-cells.stop >> TILE_BITS) if len(cells) else 0)


def _overlap(cells: range, tile: int) -> tuple[slice, slice]:
    """The part of the cells that lies in a tile: counted from the cells' first, and from the tile's."""
    first, last = max(cells.start, tile << TILE_BITS), min(cells.stop, (tile + 1) << TILE_BITS)
    origin = tile << TILE_BITS
    return slice(first - cells.start, last - cells.start), slice(first - origin, last - origin)

"""Heights in blocks: their ranges, and terrains too large for memory."""

from __future__ import annotations

import mmap
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

#: Cells on the side of the blocks whose least and greatest heights are kept.
BLOCK = 64
#: Rows of a terrain that are worked out at a time if it does not fit into memory.
STRIP = 8 * BLOCK

Heights = NDArray[np.float32]


def block_range(heights_m: Heights) -> Heights:
    """Least and greatest height (2, block rows, block columns) of each block; (inf, -inf): none known."""
    first = np.arange(0, heights_m.shape[1], BLOCK)
    rows = range(0, heights_m.shape[0], BLOCK)
    return np.stack([_strip_range(heights_m[row : row + BLOCK], first) for row in rows], axis=1)


def on_disk(strips: Iterable[Heights], shape: tuple[int, int], folder: Path) -> tuple[Heights, Heights]:
    """Heights (rows, columns) in a file without a name in a folder, and the ranges of their blocks.

    strips: STRIP rows each, from the south; the last one may be lower. The heights can only be read; what is
    read of them comes into memory, and leaves it when memory is short.
    """
    ranges = []
    with tempfile.TemporaryFile(dir=folder) as file:
        for strip in strips:
            ranges.append(block_range(strip))
            file.write(strip.tobytes())
        file.flush()
        mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    return np.frombuffer(mapped, dtype=np.float32).reshape(shape), np.concatenate(ranges, axis=1)


def _strip_range(strip: Heights, first: NDArray[np.int64]) -> Heights:
    unknown = np.isnan(strip)
    least = np.minimum.reduceat(np.where(unknown, np.float32(np.inf), strip).min(axis=0), first)
    greatest = np.maximum.reduceat(np.where(unknown, np.float32(-np.inf), strip).max(axis=0), first)
    return np.stack([least, greatest])

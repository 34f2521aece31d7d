"""How the ground moves through the pictures of a video: displacements of patches between pictures of short bursts.

Patches are matched by phase correlation, first the whole picture, then each patch about its displacement.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.ingest.checks.bursts import Burst, BurstParams, Gray, bursts_of
from pipeline.ingest.checks.phase_correlation import shift
from pipeline.messages import FloatArray


@dataclass(frozen=True)
class MotionParams:
    """patch_px: side of a patch. columns, rows: of patches. bursts: of pictures.

    least_peak: of a correlation, standard deviations above its mean, below which a patch has not been found again
    (water, sky, a picture without texture).
    """

    patch_px: int = 64
    columns: int = 5
    rows: int = 3
    least_peak: float = 9.0
    bursts: BurstParams = field(default_factory=BurstParams)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """M patches that were found again. first_s, second_s: (M,), time of the video of both pictures.

    from_px, to_px: (M, 2), the patch's middle in both, in pixels of the full-size picture. burst: (M,), its number.
    scale: full-size pixels per pixel that was compared. bursts: how many there were, with or without patches.
    sights: the first picture of each, uint8 (rows, columns), and its time.
    """

    first_s: FloatArray
    second_s: FloatArray
    from_px: FloatArray
    to_px: FloatArray
    burst: NDArray[np.int64]
    scale: float
    bursts: int
    sights: tuple[tuple[float, NDArray[np.uint8]], ...] = ()

    @property
    def displacement_px(self) -> FloatArray:
        """(M, 2), in pixels that were compared."""
        return (self.to_px - self.from_px) / self.scale


def picture_motion(
    path: Path,
    duration_s: float,
    size: tuple[int, int] | None = None,
    params: MotionParams | None = None,
    threads: int = 1,
) -> Motion:
    """The motion in a video, at moments spread over it; size, threads and what gives nothing: see ``bursts_of``."""
    params = params or MotionParams()
    rows: list[tuple[float, float, FloatArray, FloatArray, int]] = []
    number, scale = -1, 1.0
    sights: list[tuple[float, NDArray[np.uint8]]] = []
    for number, (burst, scale) in enumerate(bursts_of(path, duration_s, size, params.bursts, threads)):
        second_s, found = _farthest(burst, params)
        sights.append((burst.times_s[0], burst.pictures[0].astype(np.uint8)))
        rows += [(burst.times_s[0], second_s, start * scale, end * scale, number) for start, end in found]
    firsts, seconds, start_px, end_px, of_burst = zip(*rows, strict=True) if rows else ((), (), (), (), ())
    return Motion(
        np.array(firsts, np.float64),
        np.array(seconds, np.float64),
        np.array(start_px, np.float64).reshape(-1, 2),
        np.array(end_px, np.float64).reshape(-1, 2),
        np.array(of_burst, np.int64),
        scale,
        number + 1,
        tuple(sights),
    )


def _farthest(burst: Burst, params: MotionParams) -> tuple[float, list[tuple[FloatArray, FloatArray]]]:
    """Patches of the first picture in the last one; in one nearer to it where fewer than a third are found."""
    first, *others = burst.pictures
    time_s, found = 0.0, list[tuple[FloatArray, FloatArray]]()
    for later_s, picture in zip(burst.times_s[:0:-1], others[::-1], strict=True):
        patches = list(matched(first, picture, params))
        if len(patches) > len(found):
            time_s, found = later_s, patches
        if 3 * len(found) >= params.columns * params.rows:
            break
    return time_s, found


def matched(first: Gray, second: Gray, params: MotionParams) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Middles of the patches of one picture, and where they are in another, pixels (x, y)."""
    whole, _ = shift(first, second)
    half = params.patch_px // 2
    height, width = first.shape
    right, down = round(whole[0]), round(whole[1])
    if width - abs(right) < params.patch_px or height - abs(down) < params.patch_px:
        return  # they show too little of the same ground
    # where the second picture shows it too
    for y in np.linspace(half + max(0, -down), height - half - max(0, down), params.rows).astype(int):
        for x in np.linspace(half + max(0, -right), width - half - max(0, right), params.columns).astype(int):
            to_x, to_y = x + right, y + down
            a = first[y - half : y + half, x - half : x + half]
            b = second[to_y - half : to_y + half, to_x - half : to_x + half]
            moved, peak = shift(a, b)
            if peak >= params.least_peak and np.abs(moved).max() < 0.35 * params.patch_px:
                start = np.array([x, y], dtype=np.float64)
                yield start, np.array([to_x, to_y]) + moved

"""How far one picture's contents are from another's.

Phase correlation: C. D. Kuglin, D. C. Hines, "The phase correlation image alignment method", Proc. IEEE Conf.
Cybernetics and Society, 1975.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FloatArray


def shift(first: NDArray[np.float32], second: NDArray[np.float32]) -> tuple[FloatArray, float]:
    """How far (x, y) the second picture's contents are from the first's, pixels, and how clear that is.

    The clearness is the peak's height above the mean of the correlation, in standard deviations.
    """
    window = np.outer(np.hanning(first.shape[0]), np.hanning(first.shape[1])).astype(np.float32)
    a, b = (np.fft.rfft2((picture - picture.mean()) * window) for picture in (first, second))
    cross = np.conj(a) * b
    cross /= np.maximum(np.abs(cross), 1e-6)
    surface = np.fft.irfft2(cross, s=first.shape)
    y, x = np.unravel_index(int(np.argmax(surface)), surface.shape)
    peak = float((surface[y, x] - surface.mean()) / (surface.std() + 1e-9))
    place = [_refined(surface[y, :], int(x)), _refined(surface[:, x], int(y))]
    return np.array(place), peak


def _refined(line: FloatArray, at: int) -> float:
    """The place of a peak, by a parabola through it and its neighbours; beyond the middle it is negative."""
    n = len(line)
    left, middle, right = line[(at - 1) % n], line[at], line[(at + 1) % n]
    bend = left - 2.0 * middle + right
    offset = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    place = at + float(np.clip(offset, -0.5, 0.5))
    return place - n if place > n / 2 else place

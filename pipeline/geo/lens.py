"""How a lens bends rays (OpenCV's Brown-Conrady and rational models), and the way back.

A distortion is float64 (5,) k1, k2, p1, p2, k3, or (8,) k1, k2, p1, p2, k3, k4, k5, k6. Coordinates are x and y
of a ray with z = 1. A polynomial is no lens: far from the axis most of them fold back, so that two rays come to
one pixel. Inside of the fold the way back is unique; it is found by Newton's method, where need be in small
steps outward from the axis, so that it never lands on the other side of the fold.
"""

from __future__ import annotations

import numpy as np

from pipeline.messages import FloatArray

#: of distorted coordinates: a millionth of a pixel at any usual focal length
_TOLERANCE = 1e-10
_NEWTON_STEPS = 30
#: from the axis to a pixel, where Newton's method does not reach it at once
_OUTWARD_STEPS = 64
#: the lens model is followed along so many ways from the axis to the picture's border, on each side
_WAYS_PER_SIDE = 24


def distorted(distortion: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where rays (N,) appear, x and y (N,)."""
    p1, p2 = distortion[2], distortion[3]
    r2 = x * x + y * y
    radial = _radial(distortion, r2)
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


def undistorted(distortion: FloatArray, xd: FloatArray, yd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The rays that appear at xd, yd (N,): the inverse of ``distorted`` inside of the fold; NaN outside."""
    x, y, good = _newton(distortion, xd, yd, xd, yd)
    if not good.all():
        lost = ~good
        x[lost], y[lost], share = _outward(distortion, xd[lost], yd[lost])
        beyond = np.flatnonzero(lost)[share < 1.0]
        x[beyond], y[beyond] = np.nan, np.nan
    return x, y


def fold_radius_px(
    distortion: FloatArray,
    focal_px: tuple[float, float],
    center_px: tuple[float, float],
    size: tuple[int, int],
) -> float | None:
    """The least distance from the principal point, pixels, at which the model folds inside the picture.

    focal_px: fx, fy. center_px: cx, cy. size: width, height. None if it can be inverted everywhere in it.
    """
    if not distortion.any():
        return None
    border = _border(*size) - np.array(center_px)
    _, _, share = _outward(distortion, border[:, 0] / focal_px[0], border[:, 1] / focal_px[1])
    if (share >= 1.0).all():
        return None
    return float((share * np.hypot(border[:, 0], border[:, 1]))[share < 1.0].min())


def _radial(distortion: FloatArray, r2: FloatArray) -> FloatArray:
    k1, k2, _, _, k3 = distortion[:5]
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    if len(distortion) == 8:
        k4, k5, k6 = distortion[5:]
        radial = radial / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return np.asarray(radial)


def _radial_slope(distortion: FloatArray, r2: FloatArray) -> FloatArray:
    """The derivative of the radial factor by r2."""
    k1, k2, _, _, k3 = distortion[:5]
    above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    above_slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)
    if len(distortion) == 5:
        return np.asarray(above_slope)
    k4, k5, k6 = distortion[5:]
    below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
    below_slope = k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6)
    return np.asarray((above_slope * below - above * below_slope) / (below * below))


def _jacobian(distortion: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, ...]:
    """dx'/dx, dx'/dy, dy'/dx and dy'/dy of ``distorted``."""
    p1, p2 = distortion[2], distortion[3]
    r2 = x * x + y * y
    radial, slope = _radial(distortion, r2), _radial_slope(distortion, r2)
    across = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    return (
        radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
        across,
        across,
        radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
    )


def _newton(
    distortion: FloatArray, xd: FloatArray, yd: FloatArray, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """Newton's method from x, y; and whether it came to a ray on this side of the fold."""
    x, y = x.copy(), y.copy()
    with np.errstate(all="ignore"):
        for _ in range(_NEWTON_STEPS):
            xt, yt = distorted(distortion, x, y)
            off_x, off_y = xd - xt, yd - yt
            if not (np.maximum(np.abs(off_x), np.abs(off_y)) > _TOLERANCE).any():
                break
            a, b, c, d = _jacobian(distortion, x, y)
            det = a * d - b * c
            x, y = x + (d * off_x - b * off_y) / det, y + (a * off_y - c * off_x) / det
        xt, yt = distorted(distortion, x, y)
        near = np.maximum(np.abs(xd - xt), np.abs(yd - yt)) <= 10.0 * _TOLERANCE
        return x, y, near & before_the_fold(distortion, x, y)


def before_the_fold(
    distortion: FloatArray, x: FloatArray, y: FloatArray
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Whether the model keeps its orientation on the whole way from the axis to these rays."""
    good = np.isfinite(x) & np.isfinite(y)
    for share in np.linspace(1.0 / 16.0, 1.0, 16):
        a, b, c, d = _jacobian(distortion, share * x, share * y)
        good &= (a * d - b * c > 0.0) & (a + d > 0.0)
    return np.asarray(good)


def _outward(
    distortion: FloatArray, xd: FloatArray, yd: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The rays that appear at xd, yd, followed outward from the axis, and the share of the way that exists."""
    x, y, share = np.zeros_like(xd), np.zeros_like(yd), np.zeros_like(xd)
    going = np.ones(len(xd), dtype=bool)
    for step in np.arange(1, _OUTWARD_STEPS + 1) / _OUTWARD_STEPS:
        next_x, next_y, good = _newton(distortion, step * xd, step * yd, x, y)
        going &= good
        x, y = np.where(going, next_x, x), np.where(going, next_y, y)
        share[going] = step
    return x, y, share


def _border(width: int, height: int) -> FloatArray:
    """Pixels (N, 2) around a picture, its corners among them."""
    share = np.arange(_WAYS_PER_SIDE) / _WAYS_PER_SIDE
    zero, one = np.zeros(_WAYS_PER_SIDE), np.ones(_WAYS_PER_SIDE)
    x = np.concatenate([share, one, 1.0 - share, zero])
    y = np.concatenate([zero, share, one, 1.0 - share])
    return np.stack([x * width, y * height], axis=1)

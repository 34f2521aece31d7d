"""How far a pose between two samples may be from the straight line between them.

A sample a second does not tell when within the second the drone began to turn. The samples before and after tell that
it did: by the motion before, the pose at the next sample would have been another one, by a difference d. While the
drone goes on as before, the line is wrong by the share u of d; the change is as likely at one moment of the interval
as at another, so it has not yet come with probability 1 - u. The same backwards from the motion after. That makes a
variance of u (1 - u) (u d_before^2 + (1 - u) d_after^2), which is that of a step at an unknown moment too. It is taken
for attitudes, which turn in tenths of a second. A position cannot turn so fast: an even acceleration is wrong by
u (1 - u) d / 2, and the standard deviation is taken twice as large, since an acceleration is seldom even.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.messages import FloatArray

#: less than this, in metres or radians, is the rounding of numbers and no change of motion
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class BetweenSamples:
    """before, after: float64 (N - 1, 3), for each interval how far its end (its begin) is from where the motion before
    (after) leads: horizontal, m; height, m; attitude, rad. Zero where nothing is known of that motion.
    """

    before: FloatArray
    after: FloatArray

    def at(self, interval: int, share: float) -> FloatArray:
        """Standard deviations (3,) at a share 0..1 of an interval: horizontal (m, an axis), height (m), angle (rad)."""
        variance = share * self.before[interval] ** 2 + (1.0 - share) * self.after[interval] ** 2
        middle = share * (1.0 - share)
        return np.asarray(np.sqrt(variance) * (middle, middle, middle**0.5))


def between_samples(
    times_s: FloatArray, positions_enu: FloatArray, angles_rad: FloatArray, longest_gap_s: float
) -> BetweenSamples:
    """times_s: (N,), increasing. positions_enu: (N, 3), m. angles_rad: (N, 3), yaw, pitch, roll of the camera.

    Motion across an interval longer than the longest gap tells nothing of its neighbours.
    """
    count = len(times_s)
    if count < 3:
        return BetweenSamples(np.zeros((max(count - 1, 0), 3)), np.zeros((max(count - 1, 0), 3)))
    gap_s = np.diff(times_s)[:, None]
    moved, turned = np.diff(positions_enu, axis=0), _turns(angles_rad)
    known = (gap_s <= longest_gap_s)[:, 0]
    before, after = np.zeros((count - 1, 3)), np.zeros((count - 1, 3))
    ratio = gap_s[1:] / gap_s[:-1]
    before[1:] = _sizes(moved[1:] - moved[:-1] * ratio, turned[1:] - turned[:-1] * ratio) * known[:-1, None]
    after[:-1] = _sizes(moved[:-1] - moved[1:] / ratio, turned[:-1] - turned[1:] / ratio) * known[1:, None]
    return BetweenSamples(before, after)


def _turns(angles_rad: FloatArray) -> FloatArray:
    """Rotation vectors (N - 1, 3) from each sample to the next, in axes that turn with the camera."""
    attitudes = Rotation.from_euler("ZXY", angles_rad * (-1.0, 1.0, 1.0))
    return np.asarray((attitudes[:-1].inv() * attitudes[1:]).as_rotvec())


def _sizes(moved: FloatArray, turned: FloatArray) -> FloatArray:
    """(N, 3): sizes of differences (N, 3) in the map frame, and of turns in axes that go with the camera."""
    sizes = np.column_stack(
        [np.hypot(moved[:, 0], moved[:, 1]), np.abs(moved[:, 2]), np.linalg.norm(turned, axis=1)]
    )
    return np.where(sizes < _ROUNDING, 0.0, sizes)

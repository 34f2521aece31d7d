"""How sure a mission is of what its places are computed from."""

from __future__ import annotations

import math

from pipeline.config.base import Strict
from pipeline.config.units import (
    NonNegativeMeters,
    NonNegativePixels,
    NonNegativeRadians,
    NonNegativeSeconds,
    PositiveMeters,
    PositiveSeconds,
)


class Uncertainty(Strict):
    """Standard deviations of everything that a place is computed from; its error ellipse follows from them.

    Biases are the same for all looks of a stream, so that no number of looks averages them away; noise
    wanders with the correlation time.

    The defaults are those of a drone with plain satellite positioning: open-sky receivers state 1.5 m within
    which half of the positions lie (1.5 m / 1.177 on each axis) and heights half as good again; compasses and
    gimbals are good to a degree. With RTK a mission should say so. With all that may be 0 at 0 the map is the
    paper's.
    """

    position_bias: NonNegativeMeters = 1.3
    """Of each horizontal axis of the position."""
    height_bias: NonNegativeMeters = 2.0
    """Of the height."""
    attitude_bias: NonNegativeRadians = math.radians(1.0)
    """Of each of yaw, pitch and roll."""
    position_noise: NonNegativeMeters = 0.1
    """Of each axis of the position."""
    attitude_noise: NonNegativeRadians = math.radians(0.2)
    """Of each of yaw, pitch and roll."""
    correlation_time: PositiveSeconds = 2.0
    """For how long noise stays alike."""
    box: NonNegativePixels = 2.0
    """Of the centre of a box in a picture."""
    terrain: NonNegativeMeters = 0.25
    """Of the surface's height about a place."""
    body: NonNegativeMeters = 0.12
    """Of the middle of a person from the middle of the boxes, which posture and cover move."""
    cause_time: NonNegativeSeconds = 0.5
    """For how long what hides a person from a detector, or looks like one, stays alike: frames that are closer
    together count less than one look each. 0: every frame is a look.
    """
    widest_look: PositiveMeters = 5.0
    """A box whose place is known worse than that, by its noise and in its worst direction, raises nothing."""


#: all is known exactly and every frame is a look of its own: the paper's world
EXACT = Uncertainty().model_copy(
    update=dict.fromkeys(set(Uncertainty.model_fields) - {"correlation_time", "widest_look"}, 0.0)
)

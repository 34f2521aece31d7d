import math

import numpy as np
import pytest

from pipeline.geo.pose import enu_from_camera

EAST, NORTH, UP = np.eye(3)


@pytest.mark.parametrize(
    ("yaw_deg", "pitch_deg", "roll_deg", "right", "down", "forward"),
    [
        (0, 0, 0, EAST, -UP, NORTH),
        (90, 0, 0, -NORTH, -UP, EAST),
        (180, 0, 0, -EAST, -UP, -NORTH),
        (0, -90, 0, EAST, -NORTH, -UP),
        (90, -90, 0, -NORTH, -EAST, -UP),
        (0, -45, 0, EAST, -(UP + NORTH) / math.sqrt(2), (NORTH - UP) / math.sqrt(2)),
        (0, 0, 90, -UP, -EAST, NORTH),
    ],
)
def test_the_axes_are_djis(yaw_deg, pitch_deg, roll_deg, right, down, forward):
    rotation = enu_from_camera(*(math.radians(a) for a in (yaw_deg, pitch_deg, roll_deg)))
    np.testing.assert_allclose(rotation, np.stack([right, down, forward], axis=1), atol=1e-12)

"""A mission small enough to be worked out by hand."""

import numpy as np
import pytest

from pipeline.config.fusion import Fusion
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.terrain import Terrain


@pytest.fixture
def params() -> Fusion:
    return Fusion.model_validate(
        {
            "cell_size": {"meters": 0.5},
            "positive_max": 0.4,
            "negative_max": 0.1,
            "tukey_alpha": 0.5,
            "significant_point": "bottom_center",
            "object_size": {
                "width_min": {"meters": 0.2},
                "width_max": {"meters": 2.2},
                "height_min": {"meters": 0.2},
                "height_max": {"meters": 2.2},
            },
            "threshold": 0.7,
            "cluster_distance": {"meters": 1.5},
            "lateness": {"seconds": 2.0},
            "update_rule": "paper",
        }
    )


@pytest.fixture
def camera() -> Camera:
    return Camera(1024, 576, 900.0, 900.0, 512.0, 288.0)


@pytest.fixture
def plane() -> Terrain:
    """80 m x 80 m at height 0 around the origin, cells of 0.5 m."""
    return Terrain(LocalFrame(47.0, 8.0), -40.0, -40.0, 0.5, np.zeros((160, 160), dtype=np.float32))

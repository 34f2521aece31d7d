import numpy as np
import pytest

from pipeline.geo.camera import Camera
from pipeline.simulation.ground import Extent
from pipeline.simulation.people import random_people
from pipeline.simulation.scene import Scene, build_scene


@pytest.fixture(scope="session")
def small_camera() -> Camera:
    return Camera(160, 90, 140.0, 140.0, 80.0, 45.0)


@pytest.fixture(scope="session")
def place() -> Scene:
    scene = build_scene(5, Extent(24.0, 24.0), "train")
    return scene.with_people(random_people(np.random.default_rng(3), "train", 4, scene))

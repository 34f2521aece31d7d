"""Short moving shots over random scenes, as a mission's camera would take them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.messages import CameraPose
from pipeline.simulation.dataset import CAMERA, MISSION_VIEWS, LabelledPicture, labelled, random_pose
from pipeline.simulation.ground import Extent
from pipeline.simulation.people import random_people
from pipeline.simulation.renderer import Renderer
from pipeline.simulation.scene import build_scene

_SPEED_MPS = 3.0
_PEOPLE = 18
_EXTENT = Extent(60.0, 60.0)


def flight_over_scene(seed: int, frames: int, rate_hz: float) -> Iterator[LabelledPicture]:
    """Pictures of a straight flight at 3 m/s, 15 m above ground, 45 degrees down, over a scene.

    The flight's middle has a person, or any point of the place, in its picture.
    """
    rng = np.random.default_rng([seed, 3])
    place = build_scene(seed, _EXTENT, "mission")
    scene = place.with_people(random_people(rng, "mission", _PEOPLE, place))
    renderer = Renderer(scene, CAMERA)
    middle = random_pose(scene, MISSION_VIEWS, rng)
    heading = middle.enu_from_camera[:, 2] * [1.0, 1.0, 0.0]
    step = heading / np.linalg.norm(heading) * _SPEED_MPS / rate_hz
    for i in range(frames):
        pose = CameraPose(middle.position_enu + (i - frames / 2) * step, middle.enu_from_camera)
        yield labelled(renderer.render(pose, time_s=i / rate_hz, rng=rng))

"""Single labelled pictures of random scenes, to train detectors on and to measure them with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.geo.camera import Camera
from pipeline.geo.pose import enu_from_camera
from pipeline.messages import CameraPose, FloatArray
from pipeline.simulation.ground import Extent
from pipeline.simulation.people import random_people
from pipeline.simulation.renderer import Picture, Renderer
from pipeline.simulation.scene import Scene, build_scene

#: the camera of the simulated missions
CAMERA = Camera(1024, 576, 900.0, 900.0, 512.0, 288.0)
_EXTENT = Extent(60.0, 60.0)
_CLEARANCE_M = 4.0


@dataclass(frozen=True, slots=True)
class Views:
    """From where pictures are taken: ranges (low, high), and how many people there are at the place.

    height_m: above the bare ground that is aimed at, its logarithm uniform. pitch_deg: below the horizon
    negative. aimed: share of pictures that aim at a person. crowds: numbers of people, drawn anew every
    shots_per_crowd pictures. beside: share of people close to things that may hide them.
    """

    height_m: tuple[float, float]
    pitch_deg: tuple[float, float]
    aimed: float
    crowds: tuple[int, ...]
    beside: float
    shots_per_crowd: int = 8


TRAINING_VIEWS = Views((5.5, 30.0), (-85.0, -30.0), aimed=0.85, crowds=(0, 20, 36, 36, 48), beside=0.3)
MISSION_VIEWS = Views((15.0, 15.0), (-45.0, -45.0), aimed=0.7, crowds=(9,), beside=0.15)
#: people of every size, to see what a detector makes of each
SIZE_VIEWS = Views((5.0, 22.0), (-80.0, -30.0), aimed=0.9, crowds=(20,), beside=0.15)


@dataclass(frozen=True, slots=True, eq=False)
class LabelledPicture:
    """image: uint8 (H, W, 3) RGB. boxes_px: (N, 4) xyxy of what is visible. visible_shares: (N,) 0..1."""

    image: NDArray[np.uint8]
    boxes_px: FloatArray
    visible_shares: FloatArray


def labelled(picture: Picture) -> LabelledPicture:
    """A rendered picture with its boxes as arrays."""
    boxes = np.array([person.box_px for person in picture.people], float).reshape(-1, 4)
    return LabelledPicture(
        picture.image, boxes, np.array([person.visible_share for person in picture.people], float)
    )


def pictures_of_scene(
    seed: int, split: Literal["train", "mission"], count: int, views: Views
) -> Iterator[LabelledPicture]:
    """count pictures of the scene with this seed; the same arguments give the same pictures."""
    rng = np.random.default_rng([seed, 1])
    place = build_scene(seed, _EXTENT, split)
    for shot in range(count):
        if shot % views.shots_per_crowd == 0:
            scene = place.with_people(
                random_people(rng, split, int(rng.choice(views.crowds)), place, beside=views.beside)
            )
            renderer = Renderer(scene, CAMERA)
        pose = random_pose(scene, views, rng)
        yield labelled(renderer.render(pose, time_s=float(rng.uniform(0.0, 30.0)), rng=rng))


def random_pose(scene: Scene, views: Views, rng: np.random.Generator) -> CameraPose:
    """A pose that has a person, or any point of the place, somewhere in the picture."""
    for _ in range(100):
        target = _target(scene, views, rng)
        rotation = enu_from_camera(
            rng.uniform(-np.pi, np.pi),
            np.radians(rng.uniform(*views.pitch_deg)),
            np.radians(rng.normal(0.0, 1.5)),
        )
        pixel = np.array([[rng.uniform(0.08, 0.92) * CAMERA.width, rng.uniform(0.1, 0.9) * CAMERA.height]])
        ray = (CAMERA.rays(pixel) @ rotation.T)[0]
        height_m = np.exp(rng.uniform(*np.log(views.height_m)))
        position = target - ray * (height_m / -ray[2]) if ray[2] < -0.2 else target
        if _is_clear(scene, position):
            break
    return CameraPose(position, rotation)


def _target(scene: Scene, views: Views, rng: np.random.Generator) -> FloatArray:
    east, north = rng.uniform(-0.45, 0.45, 2) * [_EXTENT.width_m, _EXTENT.depth_m]
    if scene.people and rng.random() < views.aimed:
        person = scene.people[rng.integers(len(scene.people))]
        east, north = person.east_m, person.north_m
    ground = scene.ground.height(np.array([east]), np.array([north]))[0]
    return np.array([east, north, ground])


def _is_clear(scene: Scene, position: FloatArray) -> bool:
    """Whether the camera hangs free, well above everything below it."""
    surface = scene.surface_height(position[:1], position[1:2])[0]
    return bool(position[2] > surface + _CLEARANCE_M)

"""Who is in a scene, where, and how each moves."""

from __future__ import annotations

import numpy as np

from pipeline.messages import FloatArray
from pipeline.simulation.bodies import BodyModel, body_mesh, footprint_radius, walking
from pipeline.simulation.mesh import Mesh, rotation_z
from pipeline.simulation.models import MISSION_MODELS, camouflaged, random_train_model
from pipeline.simulation.person import Person
from pipeline.simulation.scene import Scene, clear_of
from pipeline.simulation.spots import anywhere, beside_things

_STEP_M = 0.72
#: the share of a lying body that presses into the grass
_SUNKEN = 0.1
#: the share of training's people who wear the colours of the place
_CAMOUFLAGED = 0.3


def placed(person: Person, scene: Scene, time_s: float) -> Mesh:
    """The body in the map frame at a time, settled on the bare ground."""
    east, north, heading = person.at(time_s)
    body = _body(person, time_s).moved(rotation_z(-heading), (east, north, 0.0))
    clearance = body.vertices[:, 2] - scene.ground.hills(body.vertices[:, 0], body.vertices[:, 1])
    sole = float(np.quantile(clearance, 0.02 if person.model.posture.rest == "upright" else _SUNKEN))
    return body.moved(np.eye(3), (0.0, 0.0, scene.ground.base_m - sole))


def reference_point(person: Person, scene: Scene, time_s: float) -> FloatArray:
    """The person's place (3,): the middle of the footprint, on the ground."""
    east, north, _ = person.at(time_s)
    height = scene.ground.height(np.array([east]), np.array([north]))[0]
    return np.array([east, north, height])


def random_people(
    rng: np.random.Generator,
    split: str,
    count: int,
    scene: Scene,
    apart_m: float = 3.0,
    beside: float = 0.0,
) -> tuple[Person, ...]:
    """So many people at free places of the area (fewer if there is no room), of the split's body models.

    beside: the share who are close to things that may hide them.
    """
    people: list[Person] = []
    for number in range(count):
        model = _model(rng, split, number, scene)
        radius = footprint_radius(body_mesh(model))
        draw = beside_things(rng, scene, radius) if beside and rng.random() < beside else anywhere(rng, scene)
        for _ in range(60):
            east, north = draw()
            apart = all(np.hypot(p.east_m - east, p.north_m - north) > apart_m for p in people)
            if apart and clear_of(scene.obstacles, east, north, radius):
                people.append(Person(len(people), model, east, north, float(rng.uniform(0, 2 * np.pi))))
                break
    return tuple(people)


def _model(rng: np.random.Generator, split: str, number: int, scene: Scene) -> BodyModel:
    if split == "train":
        model = random_train_model(rng)
        return camouflaged(rng, model, scene.palette) if rng.random() < _CAMOUFLAGED else model
    return MISSION_MODELS[number % len(MISSION_MODELS)]


def _body(person: Person, time_s: float) -> Mesh:
    if person.speed_mps == 0.0:
        return body_mesh(person.model)
    phase = np.pi * person.speed_mps * time_s / _STEP_M
    return body_mesh(person.model, walking(phase))

"""A scenario made concrete: the place with its people, and the way of each drone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.config.scenario import Scenario
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.simulation.flight import Flight, plan_flights
from pipeline.simulation.ground import Extent
from pipeline.simulation.person import Person
from pipeline.simulation.places import mission_people
from pipeline.simulation.scene import Scene, build_scene

_PEOPLE_STREAM = 4


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """Everything that the files are written from; the same scenario gives the same one in every process."""

    scenario: Scenario
    scene: Scene
    camera: Camera
    frame: LocalFrame
    flights: tuple[Flight, ...]


def rehearse(scenario: Scenario, people: tuple[Person, ...] | None = None) -> Rehearsal:
    """Build the scene, put the people in it and plan the flights. people: if they are known already.

    Raises InputError if they have no room.
    """
    area, calibration, origin = scenario.area, scenario.camera, scenario.origin
    extent = Extent(area.width, area.depth)
    camera = Camera(
        calibration.width, calibration.height, calibration.fx, calibration.fy, calibration.cx, calibration.cy,
        np.array(calibration.distortion),
    )  # fmt: skip
    empty = build_scene(scenario.seed, extent, "mission", origin.height)
    if people is None:
        rng = np.random.default_rng([scenario.seed, _PEOPLE_STREAM])
        people = mission_people(rng, scenario.people, scenario.flight, empty)
    scene = empty.with_people(people)
    rate = scenario.recording.frame_rate
    flights = plan_flights(scenario.flight, camera, extent, rate, scene.ground.height)
    frame = LocalFrame(math.degrees(origin.latitude), math.degrees(origin.longitude))
    return Rehearsal(scenario, scene, camera, frame, flights)

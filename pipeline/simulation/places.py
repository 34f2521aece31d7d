"""Where the people of a mission are: most in the open, some half hidden, some walking."""

from __future__ import annotations

import numpy as np

from pipeline.config.scenario import FlightPlan
from pipeline.config.scenario import People as PeoplePlan
from pipeline.errors import InputError
from pipeline.messages import FloatArray
from pipeline.simulation.bodies import BodyModel, body_mesh, footprint_radius
from pipeline.simulation.models import MISSION_MODELS
from pipeline.simulation.people import placed
from pipeline.simulation.person import Person
from pipeline.simulation.scene import Scene, clear_of
from pipeline.simulation.spots import BORDER_M, anywhere, beside_things

_TRIES = 400
_OPEN_SHARE = 0.95
#: how far from one half the mean visible share of a half hidden person may be
_HALF = 0.25


def mission_people(
    rng: np.random.Generator, plan: PeoplePlan, flight: FlightPlan, scene: Scene
) -> tuple[Person, ...]:
    """The mission's people, each model in turn. Raises InputError if the area has no room for them."""
    people: list[Person] = []
    for number in range(plan.places):
        model = MISSION_MODELS[number % len(MISSION_MODELS)]
        hidden = number < plan.half_hidden
        walks = number >= plan.places - plan.walkers
        speed = plan.walking_speed if walks else 0.0
        person = _best(rng, people, model, speed, hidden, plan, flight, scene)
        if person is None:
            found = f"no {'half hidden' if hidden else 'free'} place for person {number + 1} of {plan.places}"
            raise InputError("people.places", found, "fewer people, a larger area, or another seed")
        people.append(person)
    return tuple(people)


def exposure(person: Person, scene: Scene, flight: FlightPlan) -> FloatArray:
    """The shares (6,), 0..1, of the body's near side that nothing hides, from lanes south and north."""
    body = placed(person, scene, 0.0)
    starts = body.vertices + 0.02 * body.normals
    above = starts[:, 2] > scene.ground.height(starts[:, 0], starts[:, 1]) + 0.03
    away = flight.height / np.tan(-flight.pitch)
    clear = []
    for north in (-away, away):
        for east in (-6.0, 0.0, 6.0):
            camera = np.array([person.east_m + east, person.north_m + north, starts[0, 2] + flight.height])
            rays = camera - starts
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            facing = above & (np.sum(rays * body.normals, axis=1) > 0.1)
            clear.append(1.0 - scene.caster.blocked(starts[facing], rays[facing]).mean())
    return np.array(clear)


def _best(
    rng: np.random.Generator,
    others: list[Person],
    model: BodyModel,
    speed_mps: float,
    hidden: bool,
    plan: PeoplePlan,
    flight: FlightPlan,
    scene: Scene,
) -> Person | None:
    """The first open place, or the one of many that hides the person most nearly by half."""
    radius = footprint_radius(body_mesh(model))
    draw = beside_things(rng, scene, radius) if hidden else anywhere(rng, scene)
    best, best_error = None, np.inf
    for _ in range(_TRIES):
        east, north = draw()
        heading = float(rng.uniform(0.0, 2.0 * np.pi))
        person = Person(len(others), model, east, north, heading, speed_mps)
        if not _fits(person, others, radius, plan.apart, scene):
            continue
        shares = exposure(person, scene, flight)
        if not hidden and shares.min() >= _OPEN_SHARE:
            return person
        error = float(np.abs(shares - 0.5).mean() + abs(shares.mean() - 0.5))
        if hidden and error < best_error and abs(shares.mean() - 0.5) < _HALF:
            best, best_error = person, error
    return best


def _fits(person: Person, others: list[Person], radius_m: float, apart_m: float, scene: Scene) -> bool:
    ways = _way(person)
    half_x, half_y = scene.extent.width_m / 2.0 - BORDER_M, scene.extent.depth_m / 2.0 - BORDER_M
    inside = bool(np.all(np.abs(ways[:, 0]) <= half_x) and np.all(np.abs(ways[:, 1]) <= half_y))
    return inside and all(
        clear_of(scene.obstacles, e, n, radius_m)
        and all(np.hypot(_way(o)[:, 0] - e, _way(o)[:, 1] - n).min() > apart_m for o in others)
        for e, n in ways
    )


def _way(person: Person) -> FloatArray:
    """Points (N, 2) of where a person ever is: one, or the circle that a walker goes."""
    if person.speed_mps == 0.0:
        return np.array([[person.east_m, person.north_m]])
    round_s = 2.0 * np.pi * person.turn_radius_m / person.speed_mps
    return np.array([person.at(t)[:2] for t in np.linspace(0.0, round_s, 24, endpoint=False)])

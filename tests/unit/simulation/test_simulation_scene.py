import numpy as np
import pytest

from pipeline.simulation.bodies import body_mesh, footprint_radius
from pipeline.simulation.models import MISSION_MODELS, random_train_model
from pipeline.simulation.people import Person, placed, random_people, reference_point
from pipeline.simulation.scene import clear_of


def brute_force_height(mesh, east, north):
    """Greatest height at which a vertical line meets a triangle."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    p = np.array([east, north])
    area = np.cross(b - a, c - a)[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):  # upright triangles have no area from above
        u = ((p[0] - a[:, 0]) * (c - a)[:, 1] - (p[1] - a[:, 1]) * (c - a)[:, 0]) / area
        v = ((b - a)[:, 0] * (p[1] - a[:, 1]) - (b - a)[:, 1] * (p[0] - a[:, 0])) / area
        inside = (np.abs(area) > 1e-12) & (u >= 0) & (v >= 0) & (u + v <= 1)
        heights = a[:, 2] + u * (b - a)[:, 2] + v * (c - a)[:, 2]
    return heights[inside].max()


def test_the_surface_is_the_highest_triangle(place):
    rng = np.random.default_rng(0)
    east, north = rng.uniform(-12, 12, 12), rng.uniform(-12, 12, 12)
    wanted = [brute_force_height(place.mesh, e, n) for e, n in zip(east, north, strict=True)]
    assert place.surface_height(east, north) == pytest.approx(wanted, abs=1e-3)


def test_the_surface_is_never_below_the_ground(place):
    rng = np.random.default_rng(1)
    east, north = rng.uniform(-30, 30, 2000), rng.uniform(-30, 30, 2000)
    assert np.all(place.surface_height(east, north) >= place.ground.height(east, north) - 0.05)


def test_nobody_stands_in_a_thing(place):
    people = random_people(np.random.default_rng(9), "mission", 9, place)
    for person in people:
        radius = footprint_radius(body_mesh(person.model))
        assert clear_of(place.obstacles, person.east_m, person.north_m, radius)


def test_a_body_rests_on_the_ground(place):
    for k, model in enumerate(MISSION_MODELS):
        body = placed(Person(k, model, 3.0, -4.0, 1.0), place, 0.0)
        clearance = body.vertices[:, 2] - place.ground.height(body.vertices[:, 0], body.vertices[:, 1])
        assert -0.15 < clearance.min() <= 0.001


def test_the_reference_point_is_the_middle_of_the_footprint(place):
    person = Person(0, MISSION_MODELS[0], 3.0, -4.0, 0.0)
    vertices, point = placed(person, place, 0.0).vertices, reference_point(person, place, 0.0)
    assert 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))[:2] == pytest.approx(point[:2])
    assert point[2] == pytest.approx(place.ground.height(np.array([3.0]), np.array([-4.0]))[0])


def test_a_walker_goes_at_the_given_speed():
    person = Person(0, MISSION_MODELS[8], 0.0, 0.0, 0.3, speed_mps=1.2)
    before, after = np.array(person.at(2.0)), np.array(person.at(2.001))
    assert np.hypot(*(after - before)[:2]) / 0.001 == pytest.approx(1.2, rel=1e-3)
    ahead = np.arctan2(*(after - before)[:2])
    assert ahead == pytest.approx(before[2], abs=1e-3)


def test_training_and_missions_share_no_body_model():
    rng = np.random.default_rng(2)
    drawn = [random_train_model(rng) for _ in range(300)]
    outfits = {(m.clothes.jacket, m.clothes.trousers) for m in drawn}
    assert not outfits & {(m.clothes.jacket, m.clothes.trousers) for m in MISSION_MODELS}
    assert not {m.posture for m in drawn} & {m.posture for m in MISSION_MODELS}


def test_there_are_eight_body_models_and_every_triangle_is_whole():
    assert len({m.name for m in MISSION_MODELS}) >= 8
    for model in MISSION_MODELS:
        mesh = body_mesh(model)
        assert 800 < len(mesh.faces) < 4000
        assert np.isfinite(mesh.vertices).all()
        assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1.0)
        assert mesh.vertices[:, 2].min() == pytest.approx(0.0)
        assert mesh.vertices[:, 2].max() < 1.35 * model.height_m

from dataclasses import replace

import numpy as np
import pytest

from pipeline.geo.pose import enu_from_camera
from pipeline.messages import CameraPose
from pipeline.simulation.caster import Caster
from pipeline.simulation.ground import Extent
from pipeline.simulation.mesh import box, merged
from pipeline.simulation.models import MISSION_MODELS
from pipeline.simulation.people import Person, random_people, reference_point
from pipeline.simulation.renderer import Renderer
from pipeline.simulation.scene import Scene, build_scene

STANDING, ARMS_OUT = MISSION_MODELS[1:3]


def above(scene: Scene, east: float, north: float, height: float = 12.0) -> CameraPose:
    """A camera 45 degrees down, south of a place that is then in the middle of the picture."""
    ground = float(scene.ground.height(np.array([east]), np.array([north]))[0])
    return CameraPose(
        np.array([east, north - height, ground + height]), enu_from_camera(0.0, -np.pi / 4, 0.0)
    )


def rng(seed=0):
    return np.random.default_rng(seed)


def test_the_same_seed_gives_the_same_bytes(place, small_camera):
    again = build_scene(5, Extent(24.0, 24.0), "train")
    again = again.with_people(random_people(rng(3), "train", 4, again))
    pose = above(place, 0.0, 0.0)
    one = Renderer(place, small_camera).render(pose, 0.0, rng())
    other = Renderer(again, small_camera).render(pose, 0.0, rng())
    assert one.image.tobytes() == other.image.tobytes()
    assert one.people == other.people


def test_another_split_gives_another_place(place, small_camera):
    mission = build_scene(5, Extent(24.0, 24.0), "mission")
    pose = above(place, 0.0, 0.0)
    one = Renderer(place.with_people(()), small_camera).render(pose, 0.0, rng())
    other = Renderer(mission, small_camera).render(pose, 0.0, rng())
    assert one.image.tobytes() != other.image.tobytes()


def test_only_the_noise_depends_on_the_rng(place, small_camera):
    renderer, pose = Renderer(place, small_camera), above(place, 0.0, 0.0)
    one, other = renderer.render(pose, 0.0, rng(1)), renderer.render(pose, 0.0, rng(2))
    difference = one.image.astype(int) - other.image.astype(int)
    assert one.people == other.people
    assert 0 < np.abs(difference).max() < 16


def test_the_reference_point_projects_into_the_full_box(place, small_camera):
    renderer = Renderer(place, small_camera)
    for person in place.people:
        pose = above(place, person.east_m, person.north_m, 9.0)
        seen = {p.id: p for p in renderer.render(pose, 0.0, rng()).people}
        if person.id in seen:
            x0, y0, x1, y1 = seen[person.id].full_box_px
            x, y = small_camera.project_enu(reference_point(person, place, 0.0)[None], pose)[0]
            assert x0 - 1 <= x <= x1 + 1
            assert y0 - 1 <= y <= y1 + 1


def bare(scene: Scene) -> Scene:
    """The scene without things, shadows of things and people."""
    mesh, light = scene.ground.mesh, replace(scene.ground_light, light=np.ones_like(scene.ground_light.light))
    return replace(scene, mesh=mesh, ground_light=light, caster=Caster(mesh.vertices, mesh.faces), people=())


def with_wall(scene: Scene, east: float, north: float, width_m: float) -> Scene:
    ground = float(scene.ground.height(np.array([east]), np.array([north]))[0])
    mesh = merged([scene.mesh, box((east, north, ground), (width_m, 0.1, 8.0), (0.5, 0.5, 0.5))])
    sun = np.ones(len(mesh.vertices), np.float32)
    return replace(scene, mesh=mesh, sun=sun, caster=Caster(mesh.vertices, mesh.faces))


@pytest.mark.parametrize("model", MISSION_MODELS, ids=lambda m: m.name)
def test_who_stands_free_is_wholly_visible(place, small_camera, model):
    scene = bare(place).with_people((Person(0, model, 1.0, 2.0, 0.4),))
    seen = Renderer(scene, small_camera).render(above(scene, 1.0, 2.0, 9.0), 0.0, rng()).people
    assert len(seen) == 1
    # pressed into the grass, a lying body may lose its lowest pixels
    assert seen[0].visible_share >= (1.0 if model.posture.rest == "upright" else 0.9) - 0.03


@pytest.mark.parametrize(("width_m", "offset_m", "low", "high"), [(6.0, 0.0, 0.0, 0.0), (6.0, 3.0, 0.2, 0.8)])
def test_a_wall_in_front_hides(place, small_camera, width_m, offset_m, low, high):
    people = (Person(0, STANDING, 1.0, 2.0, 0.0),)
    scene = with_wall(bare(place), 1.0 + offset_m, 1.0, width_m).with_people(people)
    seen = Renderer(scene, small_camera).render(above(scene, 1.0, 2.0, 9.0), 0.0, rng()).people
    share = seen[0].visible_share if seen else 0.0
    assert low <= share <= high


def test_beyond_the_edge_counts_as_not_visible(place, small_camera):
    scene = bare(place).with_people((Person(0, ARMS_OUT, 0.0, 0.0, 0.0),))
    renderer = Renderer(scene, small_camera)
    pose = above(scene, 0.0, 0.0, 9.0)
    aside = CameraPose(pose.position_enu + np.array([7.2, 0.0, 0.0]), pose.enu_from_camera)
    (person,) = renderer.render(aside, 0.0, rng()).people
    assert person.box_px[0] == 0.0
    assert person.full_box_px[0] < 0.0
    assert 0.0 < person.visible_share < 1.0


def test_a_person_throws_a_shadow_away_from_the_sun(place, small_camera):
    low_in_the_west = replace(place.light, sun_direction=np.array([-np.sqrt(0.75), 0.0, 0.5]))
    scene, person = replace(bare(place), light=low_in_the_west), Person(0, STANDING, 1.0, 2.0, 0.0)
    pose, spot = above(scene, 1.0, 2.0, 9.0), reference_point(person, scene, 0.0) + np.array([1.6, 0.0, 0.0])
    spot[2] = scene.ground.height(spot[:1], spot[1:2])[0]
    x, y = small_camera.project_enu(spot[None], pose)[0].astype(int)
    without = Renderer(scene, small_camera).render(pose, 0.0, rng()).image[y, x]
    shaded = Renderer(scene.with_people((person,)), small_camera).render(pose, 0.0, rng()).image[y, x]
    assert np.all(shaded + 5.0 < without)

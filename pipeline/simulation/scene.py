"""A random piece of country with everything that stands on it, and the light baked into it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pipeline.messages import FloatArray
from pipeline.simulation import things
from pipeline.simulation.caster import Caster
from pipeline.simulation.ground import Extent, Ground, build_ground
from pipeline.simulation.lighting import GroundLight, bake_ground, sun_on_vertices
from pipeline.simulation.mesh import Mesh, merged, rotation_z
from pipeline.simulation.noise import Float32Array
from pipeline.simulation.palette import Light, Palette, random_light, random_palette
from pipeline.simulation.person import Person

_SPLITS = {"train": 1, "mission": 2}


@dataclass(frozen=True)
class Obstacle:
    """Where a thing stands: nobody is put inside radius_m. crown_m: how far its leaves reach, 0 for none."""

    east_m: float
    north_m: float
    radius_m: float
    crown_m: float = 0.0


@dataclass(frozen=True, eq=False)
class Scene:
    """One place. mesh: ground and things as one; the first ground_faces faces are the ground.

    sun: float32 (V,), the share of sunlight on each vertex of things. people: who is there.
    """

    extent: Extent
    ground: Ground
    palette: Palette
    light: Light
    mesh: Mesh
    ground_faces: int
    sun: Float32Array
    ground_light: GroundLight
    obstacles: tuple[Obstacle, ...]
    caster: Caster = field(repr=False)
    people: tuple[Person, ...] = ()

    def with_people(self, people: tuple[Person, ...]) -> Scene:
        """The same place with other people; costs nothing."""
        return replace(self, people=tuple(people))

    def surface_height(self, east_m: FloatArray, north_m: FloatArray) -> FloatArray:
        """Height of the highest surface (ground, thing, leaf; no people) at positions (N,); NaN beyond."""
        count = len(east_m)
        start = self.ceiling_m
        origins = np.column_stack([east_m, north_m, np.full(count, start)])
        hits = self.caster.hits(origins, np.tile([0.0, 0.0, -1.0], (count, 1)))
        return np.where(hits.face >= 0, start - hits.distance_m.astype(np.float64), np.nan)

    @cached_property
    def ceiling_m(self) -> float:
        """A height above everything."""
        return float(self.mesh.vertices[:, 2].max()) + 1.0


def build_scene(
    seed: int, extent: Extent, split: str = "train", base_m: float = 120.0, people: tuple[Person, ...] = ()
) -> Scene:
    """A random place; the same arguments give the same place.

    split: "train" or "mission", whose places have nothing in common. base_m: mean height above the ellipsoid.
    """
    rng = np.random.default_rng([seed, _SPLITS[split]])
    palette, light = random_palette(rng), random_light(rng)
    ground = build_ground(rng, extent, base_m, palette, light)
    standing, obstacles = _furnish(rng, ground, extent, palette, cluttered=split == "train")
    mesh = merged([ground.mesh, standing])
    caster = Caster(mesh.vertices, mesh.faces)
    return Scene(
        extent,
        ground,
        palette,
        light,
        mesh,
        len(ground.mesh.faces),
        sun_on_vertices(caster, mesh, len(ground.mesh.vertices), light),
        bake_ground(caster, ground, extent, light),
        obstacles,
        caster,
        people,
    )


def _furnish(
    rng: np.random.Generator, ground: Ground, extent: Extent, palette: Palette, cluttered: bool
) -> tuple[Mesh, tuple[Obstacle, ...]]:
    """Everything on the ground. cluttered: with many more things that a detector could take for a person."""
    area = (extent.width_m + 90.0) * (extent.depth_m + 90.0)
    meshes: list[Mesh] = []
    obstacles: list[Obstacle] = []

    def scatter(count: int, make: Callable[[], Mesh], margin_m: float, crown: bool = False) -> None:
        for _ in range(count):
            thing = make()
            reach = float(np.hypot(thing.vertices[:, 0], thing.vertices[:, 1]).max())
            body = min(0.6, reach) if crown else reach
            place = _free_place(rng, extent, obstacles, body + 0.4, margin_m)
            if place is not None:
                obstacles.append(Obstacle(*place, body, reach if crown else 0.0))
                meshes.append(_standing(rng, thing, place, ground))

    wooded, stony = rng.uniform(0.3, 1.0), rng.uniform(0.2, 1.0)
    scatter(int(rng.integers(1, 3)), lambda: things.building(rng), 0.0)
    scatter(int(area / 550.0 * wooded), lambda: things.tree(rng, palette), 40.0, crown=True)
    scatter(int(area / 350.0 * wooded), lambda: things.shrub(rng, palette), 40.0)
    scatter(int(area / 1500.0 * stony), lambda: things.boulder(rng, palette, rng.uniform(0.7, 2.2)), 40.0)
    scatter(int(area / 350.0 * stony), lambda: things.boulder(rng, palette, rng.uniform(0.15, 0.7)), 30.0)
    scatter(int(area / 1500.0), lambda: things.stump(rng, palette), 30.0)
    scatter(int(area / 1500.0), lambda: things.log(rng, palette), 30.0)
    scatter(int(rng.integers(6, 16)), lambda: things.gear(rng), 15.0)
    if cluttered:
        near = (extent.width_m + 30.0) * (extent.depth_m + 30.0)
        scatter(int(near * rng.uniform(0.004, 0.016)), lambda: _clutter(rng, palette), 15.0)
    meshes.append(_tufts(rng, ground, extent, palette))
    return merged(meshes), tuple(obstacles)


def _clutter(rng: np.random.Generator, palette: Palette) -> Mesh:
    kinds: tuple[Callable[[], Mesh], ...] = (
        lambda: things.log(rng, palette),
        lambda: things.stump(rng, palette),
        lambda: things.boulder(rng, palette, rng.uniform(0.2, 0.8)),
        lambda: things.branch(rng),
        lambda: things.heap(rng, palette),
        lambda: things.shrub(rng, palette),
        lambda: things.gear(rng),
    )
    return kinds[rng.integers(len(kinds))]()


def _tufts(rng: np.random.Generator, ground: Ground, extent: Extent, palette: Palette) -> Mesh:
    kinds = [things.tuft(rng, palette) for _ in range(12)]
    count = int((extent.width_m + 50.0) * (extent.depth_m + 50.0) * 0.12)
    east = rng.uniform(-0.5, 0.5, count) * (extent.width_m + 50.0)
    north = rng.uniform(-0.5, 0.5, count) * (extent.depth_m + 50.0)
    clumps = ground.hills(2.3 * east, 2.3 * north)
    grown = clumps > np.quantile(clumps, 0.45)
    height = ground.height(east, north)
    turns, picks = rng.uniform(0, 2 * np.pi, count), rng.integers(len(kinds), size=count)
    return merged(
        [
            kinds[picks[i]].moved(rotation_z(turns[i]), (east[i], north[i], height[i]))
            for i in np.flatnonzero(grown)
        ]
    )


def _free_place(
    rng: np.random.Generator, extent: Extent, obstacles: list[Obstacle], radius_m: float, margin_m: float
) -> tuple[float, float] | None:
    for _ in range(30):
        east = rng.uniform(-0.5, 0.5) * (extent.width_m + 2 * margin_m)
        north = rng.uniform(-0.5, 0.5) * (extent.depth_m + 2 * margin_m)
        if clear_of(obstacles, east, north, radius_m):
            return float(east), float(north)
    return None


def clear_of(
    obstacles: list[Obstacle] | tuple[Obstacle, ...], east_m: float, north_m: float, radius_m: float
) -> bool:
    """Whether a disc touches none of the things."""
    return all(np.hypot(o.east_m - east_m, o.north_m - north_m) > o.radius_m + radius_m for o in obstacles)


def _standing(rng: np.random.Generator, thing: Mesh, place: tuple[float, float], ground: Ground) -> Mesh:
    height = float(ground.height(np.array([place[0]]), np.array([place[1]]))[0])
    return thing.moved(rotation_z(rng.uniform(0, 2 * np.pi)), (*place, height))

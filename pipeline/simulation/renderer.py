"""Pictures of a scene, and who is visible in them.

A pixel is one ray from its centre, through a lens that blurs a little onto a sensor with a little noise.
People are cast apart from the static scene, so that they can walk and that what hides them is known.

    scene = build_scene(seed=1, extent=Extent(60.0, 60.0), split="train")
    scene = scene.with_people(random_people(rng, "train", 12, scene))
    picture = Renderer(scene, camera).render(pose, time_s=0.0, rng=rng)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.geo.camera import Camera
from pipeline.messages import CameraPose, FloatArray
from pipeline.simulation.caster import Caster, Hits
from pipeline.simulation.ground import SOIL_CELL_M, TEXEL_M
from pipeline.simulation.lighting import CELL_M
from pipeline.simulation.mesh import Mesh
from pipeline.simulation.noise import Float32Array
from pipeline.simulation.people import placed
from pipeline.simulation.person import Person
from pipeline.simulation.scene import Scene
from pipeline.simulation.shading import expose, rotated, shade_body, shade_static

#: nobody is drawn from further away
FARTHEST_M = 160.0
_HAZE = np.array([0.55, 0.62, 0.70], np.float32)
_BLUR = 0.16
_NOISE_LEVELS = 1.6

Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class VisiblePerson:
    """One person in one picture.

    box_px: x0, y0, x1, y1 around the visible pixels. full_box_px: around all pixels, if nothing were in
    front and the picture had no edge. visible_share: visible pixels by all pixels, 0..1.
    """

    id: int
    box_px: Box
    full_box_px: Box
    visible_share: float


@dataclass(frozen=True, eq=False)
class Picture:
    """image: uint8 (H, W, 3) RGB. people: those with a pixel in it."""

    image: NDArray[np.uint8]
    people: tuple[VisiblePerson, ...]


@dataclass(frozen=True, eq=False)
class _Body:
    """A person's mesh at a moment, ready for rays."""

    mesh: Mesh
    normals: Float32Array
    albedo: Float32Array
    cloth: Float32Array
    caster: Caster


@dataclass(frozen=True, eq=False)
class _Seen:
    """The pixels of one person: which, what the rays met there, and whether each is visible.

    column, row: int64 (N,), also beyond the picture's edges. pixel: int64 (N,), -1 beyond them. rays: (N, 3).
    """

    column: NDArray[np.int64]
    row: NDArray[np.int64]
    pixel: NDArray[np.int64]
    rays: Float32Array
    hits: Hits


class Renderer:
    """Draws a scene with one camera. Holds a cache of bodies that do not move; not for several threads."""

    def __init__(self, scene: Scene, camera: Camera) -> None:
        self.scene, self.camera = scene, camera
        columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        rays = camera.rays(np.column_stack([columns.ravel(), rows.ravel()]))
        self._rays = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)
        mesh = scene.mesh
        self._normals, self._albedo = mesh.normals.astype(np.float32), mesh.albedo.astype(np.float32)
        self._grain = mesh.grain.astype(np.float32)
        self._tile_means = scene.ground.tiles.mean(axis=(1, 2))
        self._resting: dict[int, _Body] = {}

    def render(self, pose: CameraPose, time_s: float, rng: np.random.Generator) -> Picture:
        """The picture at a pose and a time; rng: the sensor's noise."""
        rays = rotated(self._rays, pose.enu_from_camera.astype(np.float32))
        static = self.scene.caster.hits(pose.position_enu, rays)
        bodies = {person.id: self._body(person, time_s) for person in self.scene.people}
        seen = {key: found for key, body in bodies.items() if (found := self._look(body, pose)) is not None}
        owner = self._owners(static, seen)
        linear = self._shade_static(static, rays, pose, self._dimmed(bodies, static, rays, pose))
        for key, found in seen.items():
            self._shade_person(bodies[key], found, owner, key, pose, linear)
        people = [self._visible(key, found, owner) for key, found in seen.items()]
        return Picture(self._expose(linear, rng), tuple(person for person in people if person is not None))

    def _body(self, person: Person, time_s: float) -> _Body:
        if person.id in self._resting:
            return self._resting[person.id]
        mesh = placed(person, self.scene, time_s)
        cloth = np.random.default_rng(person.id).normal(1.0, 0.07, len(mesh.vertices)).astype(np.float32)
        body = _Body(
            mesh,
            mesh.normals.astype(np.float32),
            mesh.albedo.astype(np.float32),
            cloth,
            Caster(mesh.vertices, mesh.faces),
        )
        if person.speed_mps == 0.0:
            self._resting[person.id] = body
        return body

    def _look(self, body: _Body, pose: CameraPose) -> _Seen | None:
        if np.linalg.norm(body.mesh.vertices[0] - pose.position_enu) > FARTHEST_M:
            return None
        area = self._pixel_area(body.mesh.vertices, pose, self.camera.width // 2)
        if area is None or not self._touches_picture(area):
            return None
        x0, y0, x1, y1 = area
        column, row = (grid.ravel() for grid in np.meshgrid(np.arange(x0, x1), np.arange(y0, y1)))
        rays = self.camera.rays_enu(np.column_stack([column + 0.5, row + 0.5]), pose).astype(np.float32)
        hits = body.caster.hits(pose.position_enu, rays)
        met = np.flatnonzero(hits.face >= 0)
        if len(met) == 0:
            return None
        column, row = column[met], row[met]
        inside = (column >= 0) & (column < self.camera.width) & (row >= 0) & (row < self.camera.height)
        pixel = np.where(inside, row * self.camera.width + column, -1)
        some = Hits(hits.face[met], hits.u[met], hits.v[met], hits.distance_m[met])
        return _Seen(column, row, pixel, rays[met], some)

    def _pixel_area(
        self, points: FloatArray, pose: CameraPose, beyond: int
    ) -> tuple[int, int, int, int] | None:
        """First and last column and row around projected points, at most so many pixels beyond the edges."""
        pixels = self.camera.project_enu(points, pose)
        pixels = pixels[np.isfinite(pixels[:, 0])]
        if len(pixels) == 0:
            return None
        size = np.array([self.camera.width, self.camera.height])
        low = np.clip(np.floor(pixels.min(axis=0)) - 1, -beyond, size + beyond).astype(int)
        high = np.clip(np.ceil(pixels.max(axis=0)) + 1, -beyond, size + beyond).astype(int)
        return int(low[0]), int(low[1]), int(high[0]), int(high[1])

    def _touches_picture(self, area: tuple[int, int, int, int]) -> bool:
        x0, y0, x1, y1 = area
        return x1 > max(x0, 0) and y1 > max(y0, 0) and x0 < self.camera.width and y0 < self.camera.height

    def _owners(self, static: Hits, seen: dict[int, _Seen]) -> NDArray[np.int64]:
        """The person whose surface is nearest in each pixel, -1 for nobody's."""
        nearest = static.distance_m.copy()
        owner = np.full(len(nearest), -1, dtype=np.int64)
        for key, found in seen.items():
            inside = found.pixel >= 0
            pixel, distance = found.pixel[inside], found.hits.distance_m[inside]
            closer = distance < nearest[pixel]
            nearest[pixel[closer]] = distance[closer]
            owner[pixel[closer]] = key
        return owner

    def _dimmed(
        self, bodies: dict[int, _Body], static: Hits, rays: Float32Array, pose: CameraPose
    ) -> NDArray[np.bool_]:
        """Which pixels of the static scene lie in a person's shadow."""
        dimmed = np.zeros(len(rays), dtype=bool)
        sun = self.scene.light.sun_direction
        for body in bodies.values():
            area = self._pixel_area(_shadow_hull(body.mesh.vertices, sun), pose, 0)
            if area is None or not self._touches_picture(area):
                continue
            x0, y0, x1, y1 = area
            pixel = (np.arange(y0, y1)[:, None] * self.camera.width + np.arange(x0, x1)[None]).ravel()
            pixel = pixel[static.face[pixel] >= 0]
            points = pose.position_enu + static.distance_m[pixel, None] * rays[pixel]
            dimmed[pixel] |= body.caster.blocked(points + 0.01 * sun, sun)
        return dimmed

    def _shade_static(
        self, hits: Hits, rays: Float32Array, pose: CameraPose, dimmed: NDArray[np.bool_]
    ) -> Float32Array:
        scene = self.scene
        out = np.empty((len(rays), 3), dtype=np.float32)
        shade_static(
            hits.face, hits.u, hits.v, hits.distance_m, rays, pose.position_enu, dimmed,
            scene.mesh.faces, self._normals, self._albedo, self._grain, scene.sun, scene.ground_faces,
            scene.ground.tiles, self._tile_means, TEXEL_M, scene.ground.soil, SOIL_CELL_M,
            scene.ground_light.light, scene.ground_light.corner, CELL_M,
            scene.light.sun_direction, scene.light.sun, scene.light.sky, _HAZE, out,
        )  # fmt: skip
        return out

    def _shade_person(
        self,
        body: _Body,
        found: _Seen,
        owner: NDArray[np.int64],
        key: int,
        pose: CameraPose,
        linear: Float32Array,
    ) -> None:
        mine = np.flatnonzero((found.pixel >= 0) & (owner[found.pixel] == key))
        if len(mine) == 0:
            return
        hits, light = found.hits, self.scene.light
        points = pose.position_enu + hits.distance_m[mine, None] * found.rays[mine]
        start = points + 0.02 * light.sun_direction - 0.01 * found.rays[mine]
        lit = ~(
            self.scene.caster.blocked(start, light.sun_direction)
            | body.caster.blocked(start, light.sun_direction)
        )
        colors = np.empty((len(mine), 3), dtype=np.float32)
        shade_body(
            hits.face[mine], hits.u[mine], hits.v[mine], lit, body.mesh.faces, body.normals, body.albedo,
            body.cloth, light.sun_direction, light.sun, light.sky, colors,
        )  # fmt: skip
        linear[found.pixel[mine]] = colors

    def _visible(self, key: int, found: _Seen, owner: NDArray[np.int64]) -> VisiblePerson | None:
        mine = (found.pixel >= 0) & (owner[found.pixel] == key)
        if not mine.any():
            return None
        return VisiblePerson(
            key,
            _box(found.column[mine], found.row[mine]),
            _box(found.column, found.row),
            float(mine.sum() / len(mine)),
        )

    def _expose(self, linear: Float32Array, rng: np.random.Generator) -> NDArray[np.uint8]:
        height, width = self.camera.height, self.camera.width
        image = np.empty((height, width, 3), dtype=np.uint8)
        noise = rng.standard_normal((height, width), dtype=np.float32)
        expose(linear.reshape(height, width, 3), noise, _NOISE_LEVELS, _BLUR, image)
        return image


def _box(columns: NDArray[np.int64], rows: NDArray[np.int64]) -> Box:
    return float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1)


def _shadow_hull(vertices: FloatArray, sun: FloatArray) -> FloatArray:
    """Points (16, 3) around a body and the shadow that it can throw."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corners = np.array(
        [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )
    drop = (corners[:, 2:] - low[2] + 0.7) / sun[2]
    return np.concatenate([corners, corners - drop * sun])

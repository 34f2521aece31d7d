"""What stands and lies about: trees, shrubs, boulders, buildings, and things of a person's size.

Every mesh stands on z = 0 with its middle at the origin; metres.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FloatArray
from pipeline.simulation.mesh import Mesh, box, ellipsoid, flat, limb, linear, merged, painted, rotation_z
from pipeline.simulation.noise import random_waves
from pipeline.simulation.palette import Palette

_BARK = ("#54432f", "#6b5a45", "#4b4238", "#8b8375")
_PAINT = ("#2f5fa8", "#c2382e", "#d9a420", "#e0e0dc", "#3a7a4a", "#d0641e", "#4a4d55", "#7a3f78", "#343a44")
_WALLS = ("#b9aa92", "#8d5a45", "#c9c4b8", "#77624a", "#a49b8e")
_ROOFS = ("#7a4335", "#55524f", "#8a8279", "#4d5a4c")


def tree(rng: np.random.Generator, palette: Palette) -> Mesh:
    """A broad-leaved or a coniferous tree, 4 to 9 m high."""
    height = rng.uniform(4.0, 9.0)
    bark = linear(str(rng.choice(_BARK)))
    lean = rng.normal(0.0, 0.02 * height, 2)
    trunk = limb((0, 0, -0.3), (*lean, 0.75 * height), 0.035 * height, 0.012 * height, bark, grain=0.8)
    color = _leaf_color(rng, palette)
    if rng.random() < 0.35:
        crown = _cone(rng, height, color * 0.75)
    else:
        crown = _lobes(rng, height, lean, color, bark)
    return merged([trunk, *crown])


def shrub(rng: np.random.Generator, palette: Palette) -> Mesh:
    """A bush, 0.5 to 1.8 m high."""
    height = rng.uniform(0.5, 1.8)
    color = _leaf_color(rng, palette)
    lobes = []
    for _ in range(rng.integers(2, 5)):
        radii = height * rng.uniform(0.3, 0.5, 3)
        center = np.array([*rng.normal(0.0, 0.25 * height, 2), 0.8 * radii[2]])
        lobes += _foliage(rng, center, radii, color, int(260 * height + 80), 0.075)
    return merged(lobes)


def tuft(rng: np.random.Generator, palette: Palette) -> Mesh:
    """A tuft of tall grass."""
    count = int(rng.integers(7, 16))
    height = rng.uniform(0.12, 0.45)
    foot = rng.normal(0.0, 0.08, (count, 2))
    tip = foot + rng.normal(0.0, 0.45 * height, (count, 2))
    width = 0.025 * np.stack([np.ones(count), np.zeros(count)], axis=1)
    corners = np.stack(
        [
            np.column_stack([foot - width, np.full(count, -0.03)]),
            np.column_stack([foot + width, np.full(count, -0.03)]),
            np.column_stack([tip, height * rng.uniform(0.6, 1.0, count)]),
        ],
        axis=1,
    ).reshape(-1, 3)
    mix = rng.random((count, 1))
    albedo = np.repeat(palette.grass[0] * mix + palette.grass[1] * (1.0 - mix), 3, axis=0)
    albedo *= np.tile([0.6, 0.6, 1.25], count)[:, None]
    normals = np.tile([0.0, 0.0, 1.0], (3 * count, 1))
    return painted(
        corners, np.arange(3 * count, dtype=np.int32).reshape(-1, 3), normals, np.clip(albedo, 0, 0.9), 0.2
    )


def boulder(rng: np.random.Generator, palette: Palette, radius_m: float) -> Mesh:
    """A rounded, uneven stone that stands a third in the ground."""
    round_ = ellipsoid((0, 0, 0), (1, 1, 1), (0, 0, 0), sectors=28)
    points = round_.vertices
    bump = random_waves(rng, 0.6, 3.0, 0.16)(
        points[:, 0] + 0.7 * points[:, 2], points[:, 1] - 0.6 * points[:, 2]
    )
    facets = random_waves(rng, 0.5, 1.5, 0.08)(points[:, 2] * 1.3 + points[:, 1], points[:, 0])
    scale = radius_m * np.array([1.0, rng.uniform(0.6, 1.0), rng.uniform(0.5, 0.9)])
    vertices = points * (1.0 + bump + facets)[:, None] * scale
    stone = palette.gravel * rng.uniform(0.55, 1.05)
    moss = np.clip(0.35 + 1.5 * facets, 0.0, 0.7)[:, None] * (points[:, 2:3] > 0.2)
    albedo = stone * (1.0 - moss) + palette.grass[0] * 0.8 * moss
    mesh = painted(vertices, round_.faces, _smooth_normals(vertices, round_.faces), albedo, 1.0)
    return mesh.moved(rotation_z(rng.uniform(0, 2 * np.pi)), (0, 0, 0.3 * scale[2]))


def stump(rng: np.random.Generator, palette: Palette) -> Mesh:
    """What is left of a tree, about as high as a sitting person."""
    radius, height = rng.uniform(0.18, 0.4), rng.uniform(0.3, 0.9)
    bark = linear(str(rng.choice(_BARK)))
    body = limb((0, 0, -0.3), (0, 0, height - radius * 0.3), radius * 1.2, radius, bark, grain=1.0)
    top = ellipsoid((0, 0, height), (radius * 0.9, radius * 0.9, 0.05), palette.sand * 0.8, grain=0.8)
    return merged([body, top])


def log(rng: np.random.Generator, palette: Palette) -> Mesh:
    """A lying trunk, as long as a person or longer."""
    length, radius = rng.uniform(1.2, 3.5), rng.uniform(0.1, 0.28)
    bark = linear(str(rng.choice(_BARK)))
    turn = rotation_z(rng.uniform(0, 2 * np.pi))
    body = limb(
        (-length / 2, 0, radius * 0.8), (length / 2, 0, radius * 0.8), radius, radius * 0.8, bark, grain=1.0
    )
    branch = limb((0, 0, radius), (0.3, 0.5, radius + 0.4), 0.05, 0.03, bark, grain=1.0)
    end = ellipsoid((-length / 2 - radius, 0, radius), (0.04, radius, radius), palette.sand * 0.8)
    return merged([body, branch, end]).moved(turn, (0, 0, 0))


def branch(rng: np.random.Generator) -> Mesh:
    """A broken branch on the ground: a crooked stem and side shoots, about as large as a lying person."""
    bark = linear(str(rng.choice(_BARK))) * rng.uniform(0.7, 1.5)
    length, radius = rng.uniform(0.8, 2.2), rng.uniform(0.04, 0.11)
    bend = np.array([0.0, rng.uniform(-0.25, 0.25) * length, radius + rng.uniform(0.0, 0.1)])
    ends = np.array([[-length / 2, 0.0, radius], [length / 2, 0.0, radius]])
    parts = [limb(end, bend, 0.8 * radius, radius, bark, grain=1.0) for end in ends]
    for _ in range(rng.integers(1, 5)):
        root = bend + rng.uniform(0.1, 0.8) * (ends[rng.integers(2)] - bend)
        reach, turn = rng.uniform(0.3, 0.9), rng.uniform(0.0, 2.0 * np.pi)
        tip = root + reach * np.array([np.cos(turn), np.sin(turn), rng.uniform(0.0, 0.4)])
        parts.append(limb(root, tip, 0.6 * radius, 0.3 * radius, bark, grain=1.0))
    return merged(parts)


def heap(rng: np.random.Generator, palette: Palette) -> Mesh:
    """Lumps of earth, stones, leaves or cloth side by side, as large as a lying or sitting person."""
    soils = np.vstack([palette.dirt, palette.gravel, palette.sand, palette.leaves])
    parts, x = [], 0.0
    for _ in range(rng.integers(2, 6)):
        color = soils[rng.integers(len(soils))] if rng.random() < 0.8 else linear(str(rng.choice(_PAINT)))
        radii = rng.uniform((0.12, 0.1, 0.08), (0.4, 0.25, 0.28))
        center = (x, rng.normal(0.0, 0.1), 0.6 * radii[2])
        parts.append(
            ellipsoid(center, radii, color * rng.uniform(0.5, 1.1), rotation_z(rng.uniform(0, 3)), grain=1.0)
        )
        x += radii[0] * rng.uniform(0.7, 1.5)
    return merged(parts).moved(np.eye(3), (-x / 2, 0.0, 0.0))


def gear(rng: np.random.Generator) -> Mesh:
    """Something man-made and painted: a box, a barrel, a tarpaulin, a post or a sack."""
    color = linear(str(rng.choice(_PAINT))) * rng.uniform(0.6, 1.0)
    turn = rotation_z(rng.uniform(0, 2 * np.pi))
    kind = rng.integers(5)
    if kind == 0:
        size = rng.uniform(0.3, 1.3, 3) * (1, 1, 0.7)
        mesh = box((0, 0, size[2] / 2 - 0.05), size, color)
    elif kind == 1:
        mesh = limb((0, 0, 0.0), (0, 0, rng.uniform(0.6, 0.85)), 0.29, 0.29, color, grain=0.4)
    elif kind == 2:
        mesh = _tarpaulin(rng, color)
    elif kind == 3:
        mesh = merged([limb((0, 0, -0.2), (0, 0, rng.uniform(1.0, 2.2)), 0.05, 0.05, color * 0.6)])
    else:
        mesh = ellipsoid((0, 0, 0.15), rng.uniform(0.15, 0.4, 3), color)
    return mesh.moved(turn, (0, 0, 0))


def building(rng: np.random.Generator) -> Mesh:
    """A hut with a gabled roof, a door and windows."""
    length, width, wall = rng.uniform(4.0, 7.5), rng.uniform(3.0, 5.0), rng.uniform(2.2, 3.0)
    ridge, eave = wall + rng.uniform(0.9, 1.8), 0.35
    a, b = length / 2, width / 2
    walls = linear(str(rng.choice(_WALLS)))
    roof = linear(str(rng.choice(_ROOFS)))
    gables = [np.array([[s * a, -s * b, wall], [s * a, s * b, wall], [s * a, 0, ridge]]) for s in (-1.0, 1.0)]
    drop = wall - eave * (ridge - wall) / b
    slopes = [
        np.array(
            [
                [-s * (a + eave), -s * (b + eave), drop],
                [s * (a + eave), -s * (b + eave), drop],
                [s * (a + eave), 0, ridge + 0.05],
                [-s * (a + eave), 0, ridge + 0.05],
            ]
        )
        for s in (-1.0, 1.0)
    ]
    dark = linear("#2c3138")
    openings = [box((x, 0, 1.4), (0.8, width + 0.04, 0.9), dark) for x in (-a / 2, a / 2)]
    openings.append(box((0, 0, 0.95), (0.9, width + 0.05, 1.9), linear("#4d3826")))
    body = box((0, 0, wall / 2 - 0.5), (length, width, wall + 1.0), walls, 0.7)
    hut = merged([body, flat(gables, walls, 0.7), flat(slopes, roof, 0.9), *openings])
    return hut.moved(rotation_z(rng.uniform(0, 2 * np.pi)), (0, 0, 0))


def _tarpaulin(rng: np.random.Generator, color: FloatArray) -> Mesh:
    count, length, width = 9, rng.uniform(0.8, 2.4), rng.uniform(0.6, 1.6)
    x, y = np.meshgrid(np.linspace(-length / 2, length / 2, count), np.linspace(-width / 2, width / 2, count))
    folds = random_waves(rng, 0.4, 2.0, 0.06)
    z = 0.14 + np.clip(folds(x, y), -0.12, 0.3)
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)[None]).reshape(-1)
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + count + 1], 1),
            np.stack([corner, corner + count + 1, corner + count], 1),
        ]
    )
    return painted(vertices, faces, _smooth_normals(vertices, faces), color, 0.15)


def _leaf_color(rng: np.random.Generator, palette: Palette) -> FloatArray:
    mix = rng.random()
    color = palette.leaves[0] * mix + palette.leaves[1] * (1.0 - mix)
    return np.asarray(np.clip(color * rng.uniform(0.7, 1.2) * rng.normal(1.0, 0.05, 3), 0.005, 0.9))


def _lobes(
    rng: np.random.Generator, height: float, lean: FloatArray, color: FloatArray, bark: FloatArray
) -> list[Mesh]:
    meshes = []
    for _ in range(rng.integers(4, 8)):
        radii = height * rng.uniform(0.14, 0.24, 3) * (1, 1, 0.85)
        center = np.array([*(lean + rng.normal(0.0, 0.11 * height, 2)), height * rng.uniform(0.5, 0.85)])
        meshes += _foliage(rng, center, radii, color * rng.uniform(0.85, 1.15), 520, 0.135)
        meshes.append(limb((0, 0, 0.4 * height), center, 0.012 * height, 0.005 * height, bark, sectors=6))
    return meshes


def _cone(rng: np.random.Generator, height: float, color: FloatArray) -> list[Mesh]:
    meshes = []
    for level in np.linspace(0.18, 0.95, 8):
        radius = 0.26 * height * (1.02 - level) + 0.15
        center = (0.0, 0.0, level * height)
        meshes += _foliage(
            rng, np.array(center), radius * np.array([1, 1, 0.55]), color, int(160 + 200 * radius), 0.12
        )
    return meshes


def _foliage(
    rng: np.random.Generator,
    center: FloatArray,
    radii: FloatArray,
    color: FloatArray,
    count: int,
    leaf_m: float,
) -> list[Mesh]:
    """A dark core and so many leaves around it."""
    core = ellipsoid(center, 0.72 * radii, color * 0.45, sectors=10, grain=1.0)
    outward = rng.standard_normal((count, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    depth = rng.uniform(0.7, 1.08, (count, 1))
    middle = center + outward * radii * depth
    a = rng.standard_normal((count, 3))
    a *= leaf_m * rng.uniform(0.6, 1.3, (count, 1)) / np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(a, outward + rng.normal(0.0, 0.5, (count, 3))) * 0.8
    corners = np.stack([middle - a, middle + b, middle + a, middle - b], axis=1).reshape(-1, 3)
    first = 4 * np.arange(count)
    faces = np.concatenate(
        [np.stack([first, first + 1, first + 2], 1), np.stack([first, first + 2, first + 3], 1)]
    )
    shade = (0.35 + 0.75 * (depth - 0.7) / 0.38) * rng.uniform(0.75, 1.3, (count, 1))
    albedo = np.repeat(color * shade * rng.normal(1.0, 0.06, (count, 3)), 4, axis=0)
    normals = np.repeat(outward + rng.normal(0.0, 0.35, (count, 3)) + (0.0, 0.0, 0.3), 4, axis=0)
    return [core, painted(corners, faces, normals, np.clip(albedo, 0.003, 0.9), 0.2)]


def _smooth_normals(vertices: FloatArray, faces: NDArray[np.int32]) -> FloatArray:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    weighted = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(normals, faces[:, i], weighted)
    return normals

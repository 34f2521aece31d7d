"""Coloured triangle meshes and the rounded shapes that bodies and things are built from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.messages import FloatArray


@dataclass(frozen=True, eq=False)
class Mesh:
    """vertices: float64 (V, 3), metres. faces: int32 (F, 3). normals: float64 (V, 3), unit.

    albedo: float64 (V, 3), linear RGB in 0..1. grain: float64 (V,), 0..1: how strongly the texture shows.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    normals: FloatArray
    albedo: FloatArray
    grain: FloatArray

    def moved(self, rotation: FloatArray, translation: ArrayLike) -> Mesh:
        """The mesh after a rotation (3, 3) about the origin and then a translation (3,)."""
        return replace(
            self,
            vertices=self.vertices @ rotation.T + np.asarray(translation, dtype=np.float64),
            normals=self.normals @ rotation.T,
        )


def linear(color: str) -> FloatArray:
    """Linear RGB (3,) of a colour written as ``#rrggbb`` in sRGB."""
    srgb = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    return np.asarray(srgb**2.2)


def hex_color(linear_rgb: FloatArray) -> str:
    """The nearest ``#rrggbb`` of a linear RGB (3,)."""
    levels = np.round(255.0 * np.clip(linear_rgb, 0.0, 1.0) ** (1.0 / 2.2)).astype(int)
    return "#" + "".join(f"{level:02x}" for level in levels)


def painted(
    vertices: FloatArray, faces: NDArray[np.int32], normals: FloatArray, albedo: ArrayLike, grain: float = 0.3
) -> Mesh:
    """A mesh of one colour (3,) or of a colour for each vertex (V, 3)."""
    count = len(vertices)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    colors = np.broadcast_to(np.asarray(albedo, dtype=np.float64), (count, 3)).copy()
    return Mesh(vertices, faces.astype(np.int32), normals, colors, np.full(count, grain))


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """All meshes as one."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]).astype(
            np.int32
        ),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.albedo for mesh in meshes]),
        np.concatenate([mesh.grain for mesh in meshes]),
    )


def rotation_z(angle_rad: float) -> FloatArray:
    """Rotation (3, 3) about the up axis, counter-clockwise seen from above."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_x(angle_rad: float) -> FloatArray:
    """Rotation (3, 3) about the x axis."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation_y(angle_rad: float) -> FloatArray:
    """Rotation (3, 3) about the y axis."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def limb(
    start: ArrayLike,
    end: ArrayLike,
    start_radius: float,
    end_radius: float,
    albedo: ArrayLike,
    depth: float = 1.0,
    side: ArrayLike = (1.0, 0.0, 0.0),
    sectors: int = 10,
    grain: float = 0.3,
) -> Mesh:
    """A capsule between two points (3,) whose radius changes from one end to the other.

    depth: radius across ``side`` and axis as a share of the radius along ``side``.
    """
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    axis, e1, e2 = _basis(end - start, np.asarray(side, dtype=np.float64))
    angles = np.concatenate([np.linspace(-np.pi / 2, 0.0, 4), np.linspace(0.0, np.pi / 2, 4)])
    centers = np.repeat(np.stack([start, end]), 4, axis=0)
    radii = np.repeat([start_radius, end_radius], 4)
    return _revolved(centers, radii, angles, axis, e1, e2, depth, albedo, sectors, grain)


def ellipsoid(
    center: ArrayLike,
    radii: ArrayLike,
    albedo: ArrayLike,
    rotation: FloatArray | None = None,
    sectors: int = 12,
    grain: float = 0.3,
) -> Mesh:
    """An ellipsoid with three radii, metres, along the columns of a rotation (3, 3)."""
    a, b, c = np.asarray(radii, dtype=np.float64)
    angles = np.linspace(-np.pi / 2, np.pi / 2, sectors // 2 + 2)
    eye = np.eye(3)
    unit = _revolved(
        np.zeros((len(angles), 3)),
        np.ones(len(angles)),
        angles,
        eye[2],
        eye[0],
        eye[1],
        1.0,
        albedo,
        sectors,
        grain,
    )
    scaled = painted(unit.vertices * [a, b, c], unit.faces, unit.normals / [a, b, c], unit.albedo, grain)
    return scaled.moved(eye if rotation is None else rotation, center)


def box(center: ArrayLike, size: ArrayLike, albedo: ArrayLike, grain: float = 0.3) -> Mesh:
    """A box with flat faces; center (3,) and size (3,), metres."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return flat(
        [corners[list(quad)] * np.asarray(size) + np.asarray(center) for quad in quads], albedo, grain
    )


def flat(polygons: Sequence[FloatArray], albedo: ArrayLike, grain: float = 0.3) -> Mesh:
    """Convex polygons (n, 3), counter-clockwise from outside, with a normal each."""
    vertices, faces, normals, start = [], [], [], 0
    for polygon in polygons:
        count = len(polygon)
        normal = np.cross(polygon[1] - polygon[0], polygon[2] - polygon[0])
        vertices.append(polygon)
        normals.append(np.tile(normal, (count, 1)))
        faces += [(start, start + i, start + i + 1) for i in range(1, count - 1)]
        start += count
    return painted(
        np.concatenate(vertices), np.array(faces, np.int32), np.concatenate(normals), albedo, grain
    )


def _basis(along: FloatArray, side: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    axis = along / max(float(np.linalg.norm(along)), 1e-9)
    across = side - axis * (side @ axis)
    if np.linalg.norm(across) < 1e-3:
        across = np.roll(axis, 1) - axis * (np.roll(axis, 1) @ axis)
    across = across / np.linalg.norm(across)
    return axis, across, np.cross(axis, across)


def _revolved(  # type: ignore[no-untyped-def]
    centers, radii, angles, axis, e1, e2, depth, albedo, sectors, grain
) -> Mesh:
    turn = np.arange(sectors) * 2.0 * np.pi / sectors
    around = np.cos(turn)[:, None] * e1 + depth * np.sin(turn)[:, None] * e2
    outward = np.cos(turn)[:, None] * e1 + np.sin(turn)[:, None] * e2 / depth
    cos, sin = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    vertices = centers[:, None, :] + radii[:, None, None] * (cos * around[None] + sin * depth * axis)
    normals = cos * outward[None] + sin * axis
    first = np.arange(len(angles) - 1)[:, None] * sectors + np.arange(sectors)[None]
    second = first - np.arange(sectors)[None] + np.roll(np.arange(sectors), -1)[None]
    lower = np.stack([first, second, second + sectors], axis=-1).reshape(-1, 3)
    upper = np.stack([first, second + sectors, first + sectors], axis=-1).reshape(-1, 3)
    faces = np.concatenate([lower, upper])
    return painted(vertices.reshape(-1, 3), faces, normals.reshape(-1, 3), albedo, grain)

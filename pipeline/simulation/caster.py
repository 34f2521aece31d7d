"""Rays against triangles, by Embree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.messages import FloatArray
from pipeline.simulation.noise import Float32Array

try:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene
except ImportError:  # there is no wheel of it for Linux on Arm
    raise InputError(
        "simulate",
        "a machine without the library that casts rays (embreex)",
        "a computer with an x86 processor",
    ) from None


@dataclass(frozen=True, eq=False)
class Hits:
    """face: int32 (N,), -1 where a ray meets nothing. u, v: float32 (N,), barycentric.

    distance_m: float32 (N,), along the unit ray.
    """

    face: NDArray[np.int32]
    u: Float32Array
    v: Float32Array
    distance_m: Float32Array


class Caster:
    """Triangles that rays are cast against. vertices: (V, 3), metres; faces: (F, 3)."""

    def __init__(self, vertices: FloatArray, faces: NDArray[np.int32]) -> None:
        self._scene: Any = EmbreeScene()
        self._mesh: Any = TriangleMesh(
            self._scene, np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32)
        )

    def hits(self, origins: NDArray[Any], directions: NDArray[Any]) -> Hits:
        """The first triangle on each ray; origins (N, 3) or (3,), directions (N, 3), unit."""
        rays = np.ascontiguousarray(directions, np.float32)
        starts = np.ascontiguousarray(np.broadcast_to(np.asarray(origins, np.float32), rays.shape))
        found = self._scene.run(starts, rays, output=True)
        return Hits(found["primID"], found["u"], found["v"], found["tfar"])

    def blocked(self, origins: NDArray[Any], directions: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether each ray meets anything; origins (N, 3), directions (N, 3) or (3,)."""
        starts = np.ascontiguousarray(origins, np.float32)
        rays = np.ascontiguousarray(np.broadcast_to(np.asarray(directions, np.float32), starts.shape))
        return np.asarray(self._scene.run(starts, rays, query="OCCLUDED")) >= 0

"""Sunlight and sky light of everything that does not move, computed once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, zoom

from pipeline.messages import FloatArray
from pipeline.simulation.caster import Caster
from pipeline.simulation.ground import Extent, Ground
from pipeline.simulation.mesh import Mesh
from pipeline.simulation.noise import Float32Array
from pipeline.simulation.palette import Light

CELL_M = 0.125
MARGIN_M = 40.0
_LIFT_M = 0.02


@dataclass(frozen=True, eq=False)
class GroundLight:
    """light: float32 (rows, columns, 2), the share of sun and of sky on the ground; row 0 south,
    cell 0.125 m; 1 at the edge, for what lies beyond.

    corner: east and north (2,) of the first cell's corner, metres.
    """

    light: Float32Array
    corner: FloatArray


def bake_ground(caster: Caster, ground: Ground, extent: Extent, light: Light) -> GroundLight:
    """Shadows of things on the ground, and the dimness under and beside them."""
    columns = int((extent.width_m + 2 * MARGIN_M) / CELL_M) // 4 * 4
    rows = int((extent.depth_m + 2 * MARGIN_M) / CELL_M) // 4 * 4
    corner = -0.5 * CELL_M * np.array([columns, rows])
    sun = ~_blocked(caster, ground, corner, rows, columns, CELL_M, light.sun_direction)
    above = _blocked(caster, ground, corner, rows // 4, columns // 4, 4 * CELL_M, np.array([0.0, 0.0, 1.0]))
    sky = 1.0 - 0.6 * zoom(gaussian_filter(above.astype(np.float32), 1.2), 4, order=1)
    soft = gaussian_filter(sun.astype(np.float32), 0.6)
    soft[[0, -1]] = soft[:, [0, -1]] = sky[[0, -1]] = sky[:, [0, -1]] = 1.0
    return GroundLight(np.ascontiguousarray(np.stack([soft, sky], axis=-1), dtype=np.float32), corner)


def _blocked(  # type: ignore[no-untyped-def]
    caster: Caster, ground: Ground, corner: FloatArray, rows: int, columns: int, cell_m: float, direction
):
    east, north = np.meshgrid(
        corner[0] + (np.arange(columns) + 0.5) * cell_m, corner[1] + (np.arange(rows) + 0.5) * cell_m
    )
    top = np.column_stack([east.ravel(), north.ravel(), ground.height(east, north).ravel() + _LIFT_M])
    return caster.blocked(top, direction).reshape(rows, columns)


def sun_on_vertices(caster: Caster, mesh: Mesh, first: int, light: Light) -> Float32Array:
    """The share of sunlight (V,) on a mesh's vertices; 1 for those before ``first``."""
    sun = np.ones(len(mesh.vertices), dtype=np.float32)
    start = mesh.vertices[first:] + 0.03 * mesh.normals[first:] + 0.03 * light.sun_direction
    sun[first:] = ~caster.blocked(start, light.sun_direction)
    return sun

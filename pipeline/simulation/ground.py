"""The ground: hills, and four kinds of soil that change into each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pipeline.messages import FloatArray
from pipeline.simulation.mesh import Mesh, painted
from pipeline.simulation.noise import Float32Array, Waves, random_waves, tile_noise
from pipeline.simulation.palette import Light, Palette

TILE_TEXELS = 512
TEXEL_M = 0.045
SOIL_CELLS = 512
SOIL_CELL_M = 0.4
#: the ground reaches so far beyond the area, so that a camera at the edge sees no end
HORIZON_M = 260.0


@dataclass(frozen=True)
class Extent:
    """The searched area, centred on the map frame's origin; metres east and north."""

    width_m: float = 90.0
    depth_m: float = 80.0


@dataclass(frozen=True, eq=False)
class Ground:
    """base_m: mean height above the datum. hills: metres above base_m. mesh: the surface.

    tiles: float32 (5, 512, 512, 3), texel 0.045 m, periodic: linear RGB of grass, dirt, gravel and sand, and
    a grey grain of mean 1 for things. soil: float32 (512, 512, 5), cell 0.4 m, periodic: the share of each
    kind, and the brightness.
    """

    base_m: float
    hills: Waves
    mesh: Mesh
    tiles: Float32Array
    soil: Float32Array

    def height(self, east_m: FloatArray, north_m: FloatArray) -> FloatArray:
        """Height of the bare ground at positions."""
        return self.base_m + self.hills(east_m, north_m)


def build_ground(
    rng: np.random.Generator, extent: Extent, base_m: float, palette: Palette, light: Light
) -> Ground:
    """A random ground in the colours of a season."""
    hills = random_waves(rng, 9.0, 160.0, rng.uniform(0.9, 1.8))
    return Ground(
        base_m, hills, _mesh(hills, base_m, extent), _tiles(rng, palette, light), _soil(rng, palette)
    )


def _mesh(hills: Waves, base_m: float, extent: Extent) -> Mesh:
    east, north = _lines(extent.width_m), _lines(extent.depth_m)
    x, y = np.meshgrid(east, north)
    z = base_m + hills(x, y)
    step = 0.05
    slope_x = (hills(x + step, y) - hills(x - step, y)) / (2 * step)
    slope_y = (hills(x, y + step) - hills(x, y - step)) / (2 * step)
    normals = np.stack([-slope_x, -slope_y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    corner = (np.arange(len(north) - 1)[:, None] * len(east) + np.arange(len(east) - 1)[None]).reshape(-1)
    right, up = corner + 1, corner + len(east)
    faces = np.concatenate([np.stack([corner, right, up + 1], 1), np.stack([corner, up + 1, up], 1)])
    return painted(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces, normals, (0.0, 0.0, 0.0))


def _lines(length_m: float) -> FloatArray:
    inner = np.arange(0.0, length_m / 2.0 + 12.0, 0.5)
    steps = 0.5 * 1.05 ** np.arange(200)
    outer = inner[-1] + np.cumsum(steps)
    half = np.concatenate([inner, outer[outer < length_m / 2.0 + HORIZON_M]])
    return np.concatenate([-half[:0:-1], half])


def _soil(rng: np.random.Generator, palette: Palette) -> Float32Array:
    fields = [tile_noise(rng, SOIL_CELLS, 1.25, 4.0, 200.0) * 0.7 + bias for bias in palette.bias]
    weights = np.exp(7.0 * np.stack(fields, axis=-1))
    weights /= weights.sum(axis=-1, keepdims=True)
    brightness = np.clip(1.0 + 0.12 * tile_noise(rng, SOIL_CELLS, 1.1, 3.0), 0.6, 1.4)
    return np.ascontiguousarray(np.concatenate([weights, brightness[..., None]], axis=-1), dtype=np.float32)


def _tiles(rng: np.random.Generator, palette: Palette, light: Light) -> Float32Array:
    tiles = [
        _grass(rng, palette, light),
        _dirt(rng, palette, light),
        _pebbles(rng, palette.gravel, light, 36000),
        _sand(rng, palette, light),
    ]
    return np.ascontiguousarray(np.clip(np.stack([*tiles, _grain(rng)]), 0.004, 2.0), dtype=np.float32)


def _relief(height: Float32Array, light: Light, strength: float) -> Float32Array:
    """Brightness of a rough surface under the sun: what small bumps do that the mesh does not have."""
    slope_x = np.roll(height, -1, 1) - np.roll(height, 1, 1)
    slope_y = np.roll(height, -1, 0) - np.roll(height, 1, 0)
    tilt = slope_x * light.sun_direction[0] + slope_y * light.sun_direction[1]
    return np.asarray(np.clip(1.0 - strength * tilt, 0.25, 1.9), dtype=np.float32)


def _grass(rng: np.random.Generator, palette: Palette, light: Light) -> FloatArray:
    tufts = tile_noise(rng, TILE_TEXELS, 0.7, 12.0)
    dry = tile_noise(rng, TILE_TEXELS, 1.2, 3.0)
    blades = tile_noise(rng, TILE_TEXELS, 0.0, 100.0)
    mix = np.clip(0.5 + 0.28 * dry + 0.18 * blades, 0.0, 1.0)[..., None]
    color = palette.grass[0] * (1.0 - mix) + palette.grass[1] * mix
    shade = _relief(tufts, light, 0.22) * np.clip(1.0 + 0.16 * blades + 0.16 * tufts, 0.35, 1.8)
    color = np.where((rng.random(mix.shape) < 0.004), palette.sand * 0.9, color)
    return np.asarray(color * shade[..., None])


def _dirt(rng: np.random.Generator, palette: Palette, light: Light) -> FloatArray:
    lumps = tile_noise(rng, TILE_TEXELS, 1.0, 6.0)
    fine = tile_noise(rng, TILE_TEXELS, 0.1, 60.0)
    shade = _relief(lumps, light, 0.28) * np.clip(1.0 + 0.12 * fine + 0.08 * lumps, 0.4, 1.7)
    color = palette.dirt * shade[..., None]
    stones, edge = _cells(rng, 9000)
    chosen = (stones % 9 == 0) & (edge > 0.25)
    tint = palette.gravel * (0.6 + 0.7 * ((stones * 7919) % 101) / 101.0)[..., None]
    return np.asarray(np.where(chosen[..., None], tint * np.clip(edge, 0.4, 1.0)[..., None], color))


def _pebbles(rng: np.random.Generator, base: FloatArray, light: Light, count: int) -> FloatArray:
    stones, edge = _cells(rng, count)
    bright = rng.normal(1.0, 0.22, count)[stones]
    tint = 1.0 + rng.normal(0.0, 0.05, (count, 3))[stones]
    dome = np.sqrt(np.clip(edge, 0.0, 1.0))
    shade = _relief(dome.astype(np.float32), light, 0.5) * (0.4 + 0.6 * dome)
    return np.asarray(base * tint * np.clip(bright * shade, 0.12, 1.8)[..., None])


def _grain(rng: np.random.Generator) -> FloatArray:
    rough = 1.0 + 0.2 * tile_noise(rng, TILE_TEXELS, 0.5, 8.0) + 0.12 * tile_noise(rng, TILE_TEXELS, 1.3, 2.0)
    return np.repeat(np.clip(rough, 0.4, 1.7)[..., None], 3, axis=2).astype(np.float64)


def _cells(rng: np.random.Generator, count: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Which of so many random stones covers each texel (periodic), and how far inside it: 0 at the edge."""
    points = rng.random((count, 2)) * TILE_TEXELS
    x, y = np.meshgrid(np.arange(TILE_TEXELS) + 0.5, np.arange(TILE_TEXELS) + 0.5)
    found = cKDTree(points, boxsize=np.full(2, float(TILE_TEXELS))).query(np.stack([x, y], axis=-1), k=2)
    distances, owners = np.asarray(found[0]), np.asarray(found[1], dtype=np.int64)
    spacing = TILE_TEXELS / np.sqrt(count)
    return owners[..., 0], np.clip(1.6 * (distances[..., 1] - distances[..., 0]) / spacing, 0.0, 1.0)


def _sand(rng: np.random.Generator, palette: Palette, light: Light) -> FloatArray:
    warp = tile_noise(rng, TILE_TEXELS, 1.6, 3.0)
    _, y = np.meshgrid(np.arange(TILE_TEXELS), np.arange(TILE_TEXELS))
    ripples = np.sin(2.0 * np.pi * y * 44.0 / TILE_TEXELS + 3.5 * warp).astype(np.float32)
    fine = tile_noise(rng, TILE_TEXELS, 0.0, 40.0)
    lumps = tile_noise(rng, TILE_TEXELS, 0.9, 8.0)
    shade = _relief(0.35 * ripples * (warp > -0.3) + 0.9 * lumps, light, 0.16) * (
        1.0 + 0.07 * fine + 0.05 * warp
    )
    litter = np.where(rng.random(shade.shape) < 0.003, 0.45, 1.0)
    return np.asarray(0.85 * palette.sand * (shade * litter)[..., None])

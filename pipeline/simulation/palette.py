"""The colours of a place and a season, and the light of an hour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.messages import FloatArray
from pipeline.simulation.mesh import linear

#: for each season: grass (two colours), dirt, gravel, sand, leaves (two colours); how much there is of each
_SEASONS: dict[str, tuple[tuple[str, ...], tuple[float, ...]]] = {
    "early_summer": (
        ("#5f7a35", "#87984f", "#6f5b40", "#8f8b82", "#b5a27c", "#3f5f28", "#62803a"),
        (0.9, 0.0, -0.2, -0.7),
    ),
    "late_summer": (
        ("#8f8a4e", "#b0a066", "#7d6546", "#948c7e", "#bda87d", "#4c6030", "#7b7f3c"),
        (0.6, 0.3, -0.1, -0.1),
    ),
    "autumn": (
        ("#74703b", "#94814a", "#5d4a35", "#85807a", "#a28f6c", "#8a5a24", "#b07a2c"),
        (0.6, 0.4, -0.2, -0.6),
    ),
    "heath": (
        ("#6a6440", "#7d5f5a", "#54453a", "#8c8a86", "#c0b295", "#4a5638", "#66703f"),
        (0.4, 0.4, -0.1, 0.2),
    ),
    "highland": (
        ("#5c6d45", "#7b8557", "#5f5446", "#a09d97", "#aaa08a", "#2f4a30", "#466243"),
        (0.2, -0.1, 0.7, -0.3),
    ),
    "dune": (
        ("#8b9460", "#a8a873", "#94805b", "#a79f90", "#d2bf95", "#5c6e42", "#84905c"),
        (0.2, -0.2, -0.3, 0.7),
    ),
    "spring": (
        ("#5d8537", "#93ab58", "#75644b", "#99958c", "#b9aa86", "#55823a", "#8fae58"),
        (0.7, 0.4, -0.3, -0.6),
    ),
    "burnt": (
        ("#5a5540", "#857553", "#463d35", "#7a7772", "#a1937a", "#4d4a30", "#6f653e"),
        (0.1, 0.6, 0.3, -0.4),
    ),
}


@dataclass(frozen=True, eq=False)
class Palette:
    """Linear RGB. grass: (2, 3). dirt, gravel, sand: (3,). leaves: (2, 3). bias: (4,), ground by ground."""

    season: str
    grass: FloatArray
    dirt: FloatArray
    gravel: FloatArray
    sand: FloatArray
    leaves: FloatArray
    bias: FloatArray


@dataclass(frozen=True, eq=False)
class Light:
    """sun_direction: unit (3,), towards the sun. sun, sky: linear RGB (3,), light on a white floor."""

    sun_direction: FloatArray
    sun: FloatArray
    sky: FloatArray


def random_palette(rng: np.random.Generator) -> Palette:
    """The colours of one of the seasons, each a little changed."""
    season = str(rng.choice(sorted(_SEASONS)))
    names, bias = _SEASONS[season]
    colors = np.array([linear(name) for name in names])
    colors *= rng.normal(1.0, 0.06, (len(names), 3)) * rng.uniform(0.85, 1.15)
    bias_array = np.array(bias) + rng.normal(0.0, 0.25, 4)
    return Palette(season, colors[:2], colors[2], colors[3], colors[4], colors[5:], bias_array)


def random_light(rng: np.random.Generator) -> Light:
    """A sun 28 to 68 degrees high, more or less veiled."""
    azimuth, elevation = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(28.0, 68.0))
    direction = np.array(
        [np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)]
    )
    clear = rng.uniform(0.35, 1.0)
    warm = np.array([1.0, 0.95 - 0.04 * clear, 0.86 - 0.1 * clear])
    sun = 2.1 * clear * warm
    sky = (0.85 - 0.4 * clear) * np.array([0.93, 1.0, 1.12])
    brightness = 1.15 / (sun.mean() * np.sin(elevation) + sky.mean())
    return Light(direction, sun * brightness, sky * brightness)

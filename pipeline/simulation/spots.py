"""Random spots of a scene: anywhere, or close to what can hide a person."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.simulation.scene import Scene

#: an edge that nobody stands in
BORDER_M = 2.0

Draw = Callable[[], tuple[float, float]]


def anywhere(rng: np.random.Generator, scene: Scene) -> Draw:
    """Draws east and north of any spot of the area, metres."""
    half = np.array([scene.extent.width_m, scene.extent.depth_m]) / 2.0 - BORDER_M

    def draw() -> tuple[float, float]:
        east, north = rng.uniform(-half, half)
        return float(east), float(north)

    return draw


def beside_things(rng: np.random.Generator, scene: Scene, radius_m: float) -> Draw:
    """Draws east and north of spots where a thing or a crown may hide a body of this radius; metres.

    Infinite where the scene has no such thing.
    """
    half = np.array([scene.extent.width_m, scene.extent.depth_m]) / 2.0 - BORDER_M
    large = [o for o in scene.obstacles if max(o.crown_m, o.radius_m) > 0.6]
    near = [o for o in large if abs(o.east_m) < half[0] and abs(o.north_m) < half[1]]

    def draw() -> tuple[float, float]:
        if not near:
            return float("inf"), float("inf")
        thing = near[rng.integers(len(near))]
        reach = thing.radius_m + radius_m
        distance = rng.uniform(reach, max(reach + 0.4, thing.crown_m + 0.5))
        angle = rng.uniform(0.0, 2.0 * np.pi)
        return float(thing.east_m + distance * np.cos(angle)), float(thing.north_m + distance * np.sin(angle))

    return draw

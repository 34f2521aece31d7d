"""One person of a scene: who, where, and how they move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.simulation.bodies import BodyModel


@dataclass(frozen=True)
class Person:
    """One person. east_m, north_m: the footprint's middle at time 0. heading_rad: clockwise from north.

    speed_mps: > 0 for a walker, who goes round a circle of turn_radius_m to the right.
    """

    id: int
    model: BodyModel
    east_m: float
    north_m: float
    heading_rad: float
    speed_mps: float = 0.0
    turn_radius_m: float = 4.0

    def at(self, time_s: float) -> tuple[float, float, float]:
        """East, north and heading at a time."""
        turned = self.speed_mps * time_s / self.turn_radius_m
        heading, r = self.heading_rad + turned, self.turn_radius_m
        east = self.east_m + r * (np.cos(self.heading_rad) - np.cos(heading))
        north = self.north_m + r * (np.sin(heading) - np.sin(self.heading_rad))
        return float(east), float(north), float(heading)

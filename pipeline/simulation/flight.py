"""The flight: a lawn-mower pattern over the area, the camera looking along it; or a drone that hovers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.config.scenario import FlightPlan, Hover
from pipeline.geo.camera import Camera
from pipeline.geo.pose import enu_from_camera
from pipeline.messages import CameraPose, FloatArray
from pipeline.simulation.ground import Extent

#: the first picture and the turns lie so far beyond what covers the area
_OVERSHOOT_M = 4.0
#: heights follow the mean ground of a disc this wide, not each bump
_SMOOTHING_RADIUS_M = 9.0


@dataclass(frozen=True, eq=False)
class Flight:
    """The camera's way, one row for each frame.

    times_s: float64 (N,), since the start. positions_enu: float64 (N, 3).
    angles_rad: float64 (N, 3), yaw, pitch, roll.
    """

    times_s: FloatArray
    positions_enu: FloatArray
    angles_rad: FloatArray

    def pose(self, index: int) -> CameraPose:
        """Of one frame."""
        return CameraPose(self.positions_enu[index], enu_from_camera(*self.angles_rad[index]))


@dataclass(frozen=True)
class _Leg:
    """A straight line or an arc. curvature: 1/m, positive to the right; heading clockwise from north."""

    east_m: float
    north_m: float
    heading_rad: float
    length_m: float
    curvature: float = 0.0

    def at(self, s_m: float) -> tuple[float, float, float]:
        """East, north and heading after a distance."""
        h, k = self.heading_rad, self.curvature
        if k == 0.0:
            return self.east_m + s_m * math.sin(h), self.north_m + s_m * math.cos(h), h
        turned = h + k * s_m
        return (
            self.east_m + (math.cos(h) - math.cos(turned)) / k,
            self.north_m + (math.sin(turned) - math.sin(h)) / k,
            turned,
        )


def plan_flights(
    plan: FlightPlan,
    camera: Camera,
    extent: Extent,
    frame_rate_hz: float,
    ground_height: Callable[[FloatArray, FloatArray], FloatArray],
) -> tuple[Flight, ...]:
    """A flight for each drone. ground_height: of arrays of east and north."""
    if plan.hover is not None:
        return (_hovering(plan, plan.hover, frame_rate_hz, ground_height),)
    count = max(math.ceil(extent.width_m / plan.lane_spacing), plan.drones)
    spacing = extent.width_m / count
    lanes = np.array_split(-0.5 * extent.width_m + (np.arange(count) + 0.5) * spacing, plan.drones)
    return tuple(
        _flown(_legs(own, spacing, plan, camera, extent), plan, frame_rate_hz, ground_height) for own in lanes
    )


def _legs(
    lanes: FloatArray, spacing_m: float, plan: FlightPlan, camera: Camera, extent: Extent
) -> list[_Leg]:
    """Up the first lane, down the next; every strip comes into the picture from end to end."""
    half = 0.5 * extent.depth_m
    steepest = min(-plan.pitch + math.atan((camera.height - camera.cy) / camera.fy), math.pi / 2)
    near, middle = plan.height / math.tan(steepest), plan.height / math.tan(-plan.pitch)
    legs = []
    north, up = -half - near - _OVERSHOOT_M, True
    for i, east in enumerate(lanes):
        last = i == len(lanes) - 1
        end = (half - middle if last else half + _OVERSHOOT_M) * (1 if up else -1)
        heading = 0.0 if up else math.pi
        legs.append(_Leg(float(east), north, heading, abs(end - north)))
        if not last:
            bend = (1.0 if up else -1.0) * 2.0 / spacing_m
            legs.append(_Leg(float(east), end, heading, math.pi * spacing_m / 2.0, bend))
        north, up = end, not up
    return legs


def _flown(
    legs: list[_Leg],
    plan: FlightPlan,
    frame_rate_hz: float,
    ground_height: Callable[[FloatArray, FloatArray], FloatArray],
) -> Flight:
    ends = np.cumsum([leg.length_m for leg in legs])
    duration_s = min(float(ends[-1]) / plan.speed, plan.longest)
    times = np.arange(max(int(duration_s * frame_rate_hz), 1)) / frame_rate_hz
    rows = []
    for s in times * plan.speed:
        i = min(int(np.searchsorted(ends, s, side="right")), len(legs) - 1)
        rows.append(legs[i].at(float(s) - (float(ends[i]) - legs[i].length_m)))
    east, north, heading = np.array(rows).T
    height = _smoothed(ground_height, east, north) + plan.height
    angles = np.column_stack([heading, np.full_like(heading, plan.pitch), np.zeros_like(heading)])
    return Flight(times, np.column_stack([east, north, height]), angles)


def _hovering(
    plan: FlightPlan,
    hover: Hover,
    frame_rate_hz: float,
    ground_height: Callable[[FloatArray, FloatArray], FloatArray],
) -> Flight:
    times = np.arange(max(int(plan.longest * frame_rate_hz), 1)) / frame_rate_hz
    height = _smoothed(ground_height, np.array([hover.east]), np.array([hover.north])) + plan.height
    position = np.array([hover.east, hover.north, height[0]])
    angles = np.array([hover.heading, plan.pitch, 0.0])
    return Flight(times, np.tile(position, (len(times), 1)), np.tile(angles, (len(times), 1)))


def _smoothed(
    ground_height: Callable[[FloatArray, FloatArray], FloatArray], east: FloatArray, north: FloatArray
) -> FloatArray:
    steps = np.linspace(-1.0, 1.0, 9) * _SMOOTHING_RADIUS_M
    dx, dy = (grid.ravel() for grid in np.meshgrid(steps, steps))
    inside = np.hypot(dx, dy) <= _SMOOTHING_RADIUS_M
    around = ground_height(east[:, None] + dx[inside], north[:, None] + dy[inside])
    return np.asarray(around.mean(axis=1))

"""The second flight: over the areas worth a second look, straight down, as near to the ground as is asked.

A small area gets a point to hover at; a larger one strips along its long side, as far apart as the camera's
footprint and the overlap allow. The order of the areas is that of the nearest neighbour, improved by 2-opt
(G. A. Croes, "A method for solving traveling-salesman problems", Operations Research 6, 1958). The way follows the
highest surface near it. Heights of a plan count from the take-off, which need not lie as high as the ground where the
recording begins: the telemetry tells it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.config.second_look import SecondLook
from pipeline.geo.camera import Camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import FloatArray
from pipeline.second_look.areas import SecondLookArea
from pipeline.second_look.clearance import Clearance, clearance_of

#: way points are no further apart, and each is above the highest surface within this distance
STEP_M = 10.0
#: heights of the surface are float32
_TOLERANCE_M = 0.01
#: an area that fills no more than this share of the picture needs no strips
_IN_ONE_PICTURE = 0.8


@dataclass(frozen=True, eq=False)
class Waypoint:
    """position_enu: float64 (3,). hover_s: time to stay. area: the id of the area it serves; 0 on the way."""

    position_enu: FloatArray
    hover_s: float
    area: int


@dataclass(frozen=True, eq=False)
class SecondFlight:
    """waypoints: in order; none without areas. home_enu: float64 (3,), on the ground, where the way begins and ends.

    length_m: of the whole way, home and back. duration_s: with its hovering. order: ids of the areas. takeoff_m: height
    that the plan's heights count from. takeoff_is_told: by the telemetry, else it is the ground's at home. clearance:
    what the check of the whole way against the terrain found; None without a way.
    """

    waypoints: tuple[Waypoint, ...]
    home_enu: FloatArray
    length_m: float
    duration_s: float
    order: tuple[int, ...]
    takeoff_m: float = 0.0
    takeoff_is_told: bool = False
    clearance: Clearance | None = None

    @property
    def climb_m(self) -> float:
        """How high above the take-off the way is at its highest, metres; 0 without a way."""
        return (
            max((float(w.position_enu[2]) for w in self.waypoints), default=self.takeoff_m) - self.takeoff_m
        )

    @property
    def takeoff_below_home_m(self) -> float:
        """How far the take-off lies below the ground at home, metres."""
        return float(self.home_enu[2]) - self.takeoff_m


def plan_second_flight(
    areas: Sequence[SecondLookArea],
    camera: Camera,
    terrain: Terrain,
    home: FloatArray,
    params: SecondLook,
    takeoff_m: float = math.nan,
) -> SecondFlight:
    """home: float64 (2,), east and north. takeoff_m: as ``Trajectory.takeoff_m``, NaN: not known.

    Without areas the flight is empty. Raises RuntimeError for a way that comes nearer to the known surface than the
    mission asks, which would be a fault of this program.
    """
    ground = terrain.height(float(home[0]), float(home[1]))
    home_enu = np.array([home[0], home[1], 0.0 if math.isnan(ground) else ground])
    legs = {area.id: _cover(area, camera, params) for area in areas}
    order = visiting_order(home, {key: leg.mean(axis=0) for key, leg in legs.items()})
    waypoints: list[Waypoint] = []
    here = np.asarray(home, dtype=np.float64)
    for area in order:
        leg = legs[area]
        if np.linalg.norm(leg[-1] - here) < np.linalg.norm(leg[0] - here):
            leg = leg[::-1]
        waypoints += _flown(here, leg, area, terrain, params)
        here = leg[-1]
    waypoints += _flown(here, np.asarray(home)[None], 0, terrain, params) if waypoints else []
    points = np.array([home_enu, *(w.position_enu for w in waypoints), home_enu])
    told = not math.isnan(takeoff_m)
    length_m = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    duration_s = length_m / params.speed + sum(w.hover_s for w in waypoints)
    clearance = clearance_of(points[1:-1], terrain) if waypoints else None
    if clearance is not None and clearance.least_m < params.height - _TOLERANCE_M:
        raise RuntimeError(
            f"a second flight {clearance.least_m:.2f} m above the surface, not {params.height:g} m"
        )
    return SecondFlight(
        tuple(waypoints),
        home_enu,
        length_m,
        duration_s,
        tuple(order),
        takeoff_m if told else float(home_enu[2]),
        told,
        clearance,
    )


def footprint_m(camera: Camera, height_m: float) -> tuple[float, float]:
    """Across and along the flight, metres, of a picture straight down from a height."""
    return height_m * camera.width / camera.fx, height_m * camera.height / camera.fy


def _cover(area: SecondLookArea, camera: Camera, params: SecondLook) -> FloatArray:
    """Points (N, 2) of the way over an area: one to hover at, or the ends of strips, there and back."""
    middle = (area.cells_enu.max(axis=0) + area.cells_enu.min(axis=0)) / 2.0
    offsets = area.cells_enu - middle
    along = _long_axis(offsets)
    axes = np.stack([along, [along[1], -along[0]]])
    u, v = axes @ offsets.T
    width, depth = footprint_m(camera, params.height)
    # the nose of the drone points along the way, and a picture's width lies across it; at a point to hover at
    # it may point anywhere, so the smaller side counts
    if np.hypot(np.ptp(u), np.ptp(v)) <= _IN_ONE_PICTURE * min(width, depth):
        return np.asarray(middle[None])
    spacing = width * (1.0 - params.overlap)
    count = max(math.ceil((np.ptp(v) - params.overlap * width) / spacing), 1)
    lanes = v.min() + (np.arange(count) + 0.5) * np.ptp(v) / count
    ends: list[FloatArray] = []
    for k, lane in enumerate(lanes):
        near = u[np.abs(v - lane) <= width / 2.0]
        if not len(near):
            continue
        pair = np.array([[near.min(), lane], [near.max(), lane]])
        ends += list(pair if k % 2 == 0 else pair[::-1])
    return np.asarray(middle + np.array(ends) @ axes)


def _long_axis(offsets: FloatArray) -> FloatArray:
    if len(offsets) < 2:
        return np.array([0.0, 1.0])
    _, axes = np.linalg.eigh(np.cov(offsets.T))
    return np.asarray(axes[:, 1])


def visiting_order(home: FloatArray, middles: dict[int, FloatArray]) -> list[int]:
    """Ids in an order of a short round trip from home: nearest neighbour, then 2-opt to the end."""
    order: list[int] = []
    here, left = np.asarray(home), dict(middles)
    while left:
        nearest = min(left, key=lambda key: (float(np.linalg.norm(left[key] - here)), key))
        here = left.pop(nearest)
        order.append(nearest)
    points = np.array([home, *(middles[key] for key in order)])
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    tour = list(range(len(points)))
    while _improved(tour, apart):
        pass
    return [order[k - 1] for k in tour[1:]]


def _improved(tour: list[int], apart: FloatArray) -> bool:
    """Turn one piece of the round trip around if that makes it shorter."""
    n = len(tour)
    for i in range(1, n - 1):
        for j in range(i + 1, n):
            before, first, last, after = tour[i - 1], tour[i], tour[j], tour[(j + 1) % n]
            gain = apart[before, first] + apart[last, after] - apart[before, last] - apart[first, after]
            if gain > 1e-9:
                tour[i : j + 1] = tour[i : j + 1][::-1]
                return True
    return False


def _flown(
    here: FloatArray, leg: FloatArray, area: int, terrain: Terrain, params: SecondLook
) -> list[Waypoint]:
    """From here over the leg's points (N, 2), never further apart than STEP_M."""
    hover_s = params.hover if len(leg) == 1 and area else 0.0
    waypoints = []
    for k, goal in enumerate(leg):
        count = max(math.ceil(float(np.linalg.norm(goal - here)) / STEP_M), 1)
        for i in range(1, count + 1):
            spot = here + (goal - here) * i / count
            height = _highest_near(terrain, spot) + params.height
            arrived = i == count
            serves = area if k or arrived else 0
            waypoints.append(Waypoint(np.array([*spot, height]), hover_s if arrived else 0.0, serves))
        here = goal
    return waypoints


def _highest_near(terrain: Terrain, spot: FloatArray) -> float:
    """The highest known surface within STEP_M, or of the whole terrain where nothing is known."""
    reach = math.ceil(STEP_M / terrain.cell_m)
    column = int((spot[0] - terrain.east_m) / terrain.cell_m)
    row = int((spot[1] - terrain.north_m) / terrain.cell_m)
    rows = slice(max(row - reach, 0), max(row + reach + 1, 0))
    columns = slice(max(column - reach, 0), max(column + reach + 1, 0))
    near = terrain.heights_m[rows, columns]
    known = near[np.isfinite(near)]
    return float(known.max()) if known.size else float(np.nanmax(terrain.heights_m))

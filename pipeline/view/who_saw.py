"""Which seconds of which video saw a point of the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FloatArray
from pipeline.view.ground import Ground
from pipeline.view.poses import Flight

#: it is looked for somebody's chest, metres above the ground: the grid of heights is coarser than the map's
_ABOVE_M = 1.0
#: points of a line of sight that are held against the ground
_SAMPLES = 256


@dataclass(frozen=True)
class Seen:
    """from_s, to_s: of the stream's time. best_s: when it was nearest to the picture's middle; x, y: pixels then."""

    stream: str
    from_s: float
    to_s: float
    best_s: float
    x: float
    y: float


def who_saw(flights: Sequence[Flight], ground: Ground, east_m: float, north_m: float) -> tuple[Seen, ...]:
    """Stretches of all streams, in the order of streams and time; empty where the height is not known."""
    height = float(ground.heights_at(np.array([east_m]), np.array([north_m]))[0])
    if not np.isfinite(height):
        return ()
    point = np.array([east_m, north_m, height + _ABOVE_M])
    return tuple(seen for flight in flights for seen in _of(flight, ground, point))


def _of(flight: Flight, ground: Ground, point: FloatArray) -> list[Seen]:
    if not len(flight.times_s):
        return []
    pixels = _pixels(flight, point)
    camera = flight.camera
    with np.errstate(invalid="ignore"):
        sees = (pixels >= 0.0).all(axis=1) & (pixels[:, 0] <= camera.width) & (pixels[:, 1] <= camera.height)
    numbers = np.flatnonzero(sees)
    sees[numbers] = _clear(flight.positions[numbers].astype(np.float64), point, ground)
    step_s = float(np.median(np.diff(flight.times_s))) if len(flight.times_s) > 1 else 0.0
    middle = np.array([camera.width, camera.height]) / 2.0
    found = []
    for part in _stretches(sees, flight.times_s, 1.5 * step_s):
        best = part[int(np.argmin(((pixels[part] - middle) ** 2).sum(axis=1)))]
        x, y = (round(float(v), 1) for v in pixels[best])
        times = flight.times_s[part]
        found.append(
            Seen(flight.stream, float(times[0]), float(times[-1]), float(flight.times_s[best]), x, y)
        )
    return found


def _pixels(flight: Flight, point: FloatArray) -> FloatArray:
    """(N, 2), one for each pose; NaN behind the camera."""
    offsets = point - flight.positions
    in_camera = np.einsum("ni,nij->nj", offsets, flight.rotations.astype(np.float64))
    pixels = np.full((len(offsets), 2), np.nan)
    for scale in np.unique(flight.focal):
        mine = flight.focal == scale
        pixels[mine] = flight.camera.zoomed(float(scale)).project(in_camera[mine])
    return pixels


def _clear(cameras: FloatArray, point: FloatArray, ground: Ground) -> NDArray[np.bool_]:
    """Whether the ground leaves the way from each camera (N, 3) to the point free."""
    shares = np.linspace(0.0, 1.0, _SAMPLES, endpoint=False)[1:]
    ways = cameras[:, None, :] + shares[None, :, None] * (point - cameras)[:, None, :]
    with np.errstate(invalid="ignore"):
        hidden = ground.heights_at(ways[..., 0], ways[..., 1]) > ways[..., 2]
    return np.asarray(~hidden.any(axis=1))


def _stretches(sees: NDArray[np.bool_], times_s: FloatArray, gap_s: float) -> list[NDArray[np.int64]]:
    numbers = np.flatnonzero(sees)
    breaks = np.flatnonzero(np.diff(times_s[numbers]) > gap_s) + 1
    return [part for part in np.split(numbers, breaks) if len(part)]


def footprint(flight: Flight, ground: Ground, number: int) -> FloatArray:
    """What the picture's corners see, (4, 2) east and north, on a plane at the height below it; NaN above that."""
    camera, pose = flight.camera, flight.pose(number)
    corners = np.array([[0.0, 0.0], [camera.width, 0.0], [camera.width, camera.height], [0.0, camera.height]])
    rays = camera.rays_enu(corners, pose)
    east, north, up = pose.position_enu
    below = float(ground.heights_at(np.array([east]), np.array([north]))[0])
    below = float(np.nanmedian(ground.heights_m)) if np.isnan(below) else below
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(rays[:, 2] < -0.02, (below - up) / rays[:, 2], np.nan)
    return np.asarray(pose.position_enu[:2] + reach[:, None] * rays[:, :2])

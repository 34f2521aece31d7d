"""Whether two drones that filmed the same ground have each other's telemetry.

Two drones that fly alike, lane beside lane, move alike through their pictures; but what both have seen lies in one
place. Pictures of both are laid on the ground by their telemetry and matched where they overlap. With the right
telemetry many pairs agree, all of them off by the same few metres; with another drone's, none do.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from pipeline.geo.camera import Camera
from pipeline.geo.terrain import Terrain
from pipeline.ingest.checks.phase_correlation import shift
from pipeline.ingest.checks.picture_motion import Motion
from pipeline.ingest.finding import Finding
from pipeline.ingest.trajectory import Trajectory
from pipeline.messages import CameraPose, FloatArray

#: upward parts of rays that look flatter (10 degrees below the horizon) smear far ground over many cells
_LEAST_DOWN = -0.17


@dataclass(frozen=True)
class SharedGroundParams:
    """cells: on the longer side of an overlap. least_share: of the smaller picture's ground, that both must show.

    most_pairs: that are matched, those that share most. least_filled: of an overlap's cells in sight of both.
    least_peak: of a match, see ``MotionParams``. near_share: of the height above the ground, within which pairs agree.
    least_agreeing: pairs that agree, and times_more: than the other way round, to be believed (see docs/checks.md).
    least_apart: of the height, that the drones are apart from each other: a drone with two cameras has one way.
    """

    cells: int = 112
    least_share: float = 0.2
    most_pairs: int = 24
    least_filled: float = 0.4
    least_peak: float = 7.5
    near_share: float = 0.08
    least_agreeing: int = 4
    times_more: int = 3
    least_apart: float = 0.15


@dataclass(frozen=True, eq=False)
class Filmed:
    """A stream. where: its telemetry's file, for the finding."""

    where: str
    motion: Motion
    trajectory: Trajectory
    camera: Camera


@dataclass(frozen=True, eq=False)
class _View:
    """box: west, east, south, north of the ground in sight, metres."""

    camera: Camera
    pose: CameraPose
    picture: FloatArray
    scale: float
    box: FloatArray


@dataclass(frozen=True)
class SharedGround:
    """findings: two, one for each, of every two streams that have each other's telemetry.

    exchanged: those streams. apart: pairs of streams whose ground lies in one place by their own telemetry.
    """

    findings: tuple[Finding, ...]
    exchanged: frozenset[str]
    apart: frozenset[frozenset[str]]


def check_shared_ground(
    filmed: Mapping[str, Filmed], terrain: Terrain, params: SharedGroundParams | None = None
) -> SharedGround:
    """Of all pairs of streams. filmed: by their names."""
    params = params or SharedGroundParams()
    findings: list[Finding] = []
    exchanged, apart = set[str](), set[frozenset[str]]()
    for (name, one), (other_name, other) in itertools.combinations(filmed.items(), 2):
        if not _apart(one, other, terrain, params):
            continue
        own = _views(one, one.trajectory, terrain), _views(other, other.trajectory, terrain)
        others = _views(one, other.trajectory, terrain), _views(other, one.trajectory, terrain)
        told, count = agreeing(*own, terrain, params), agreeing(*others, terrain, params)
        if told >= max(params.least_agreeing, params.times_more * count):
            apart.add(frozenset((name, other_name)))
        if count < max(params.least_agreeing, params.times_more * told):
            continue
        exchanged |= {name, other_name}
        evidence = (
            f"of the ground that both show, {count} pairs of pictures agree with the telemetry exchanged, {told} as it "
            f"is (at least {params.least_agreeing}, and {params.times_more} times as many, are believed)"
        )
        for stream, its in ((one, other_name), (other, name)):
            text = f"what both drones filmed lies in one place only with the telemetry of {its}"
            mend = "exchange the streams' telemetry.file"
            findings.append(Finding("warning", "exchanged", stream.where, text, evidence, mend))
    return SharedGround(tuple(findings), frozenset(exchanged), frozenset(apart))


def agreeing(
    one: Sequence[_View], other: Sequence[_View], terrain: Terrain, params: SharedGroundParams
) -> int:
    """How many pairs of pictures are found in each other, off by the same."""
    pairs = [(_overlap(a, b), a, b) for a in one for b in other]
    shown = [
        (box, a, b)
        for box, a, b in pairs
        if _area(box) >= params.least_share * min(_area(a.box), _area(b.box))
    ]
    shown.sort(key=lambda pair: -_area(pair[0]))
    offsets = [
        found
        for box, a, b in shown[: params.most_pairs]
        if (found := _offset_m(box, a, b, _ground_m(terrain, box), params)) is not None
    ]
    if not offsets:
        return 0
    places = np.array(offsets)
    apart_m = np.linalg.norm(places[:, None] - places[None], axis=2)
    height_m = float(np.median([v.pose.position_enu[2] - _ground_m(terrain, v.box) for v in one]))
    return int((apart_m <= params.near_share * height_m).sum(axis=1).max())


def _apart(one: Filmed, other: Filmed, terrain: Terrain, params: SharedGroundParams) -> bool:
    """Whether the drones are two, by their ways at the moments of the pictures."""
    poses = [(one.trajectory.pose(t), other.trajectory.pose(t)) for t, _ in one.motion.sights]
    ways = [(a.position_enu, b.position_enu) for a, b in poses if a is not None and b is not None]
    if not ways:
        return False
    apart_m = float(np.median([np.linalg.norm(a - b) for a, b in ways]))
    ground_m = float(np.nanmedian(terrain.heights_m[:: max(1, terrain.shape[0] // 64)]))
    return apart_m > params.least_apart * float(np.median([a[2] - ground_m for a, _ in ways]))


def _views(filmed: Filmed, trajectory: Trajectory, terrain: Terrain) -> list[_View]:
    """The pictures of a stream on the ground, by a trajectory; without those that see the horizon."""
    camera, views = filmed.camera, []
    share = np.array([[0.1, 0.1], [0.9, 0.1], [0.1, 0.9], [0.9, 0.9]])
    corners = share * [camera.width, camera.height]
    ground_m = float(np.nanmedian(terrain.heights_m[:: max(1, terrain.shape[0] // 64)]))
    for time_s, picture in filmed.motion.sights:
        pose = trajectory.pose(time_s)
        if pose is None:
            continue
        rays = camera.rays_enu(corners, pose)
        if (rays[:, 2] > _LEAST_DOWN).any() or pose.position_enu[2] <= ground_m:
            continue
        places = pose.position_enu + rays * ((ground_m - pose.position_enu[2]) / rays[:, 2])[:, None]
        (west, south), (east, north) = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
        box = np.array([west, east, south, north])
        views.append(_View(camera, pose, picture.astype(np.float64), filmed.motion.scale, box))
    return views


def _overlap(one: _View, other: _View) -> FloatArray:
    low, high = np.maximum(one.box, other.box), np.minimum(one.box, other.box)
    return np.array([low[0], high[1], low[2], high[3]])


def _area(box: FloatArray) -> float:
    return float(max(0.0, box[1] - box[0]) * max(0.0, box[3] - box[2]))


def _ground_m(terrain: Terrain, box: FloatArray) -> float:
    height_m = terrain.height(float(box[:2].mean()), float(box[2:].mean()))
    return height_m if np.isfinite(height_m) else float(np.nanmedian(terrain.heights_m))


def _offset_m(
    box: FloatArray, one: _View, other: _View, ground_m: float, params: SharedGroundParams
) -> FloatArray | None:
    """How far (2,) the second picture's ground lies from the first's; None if it is not found."""
    cell_m = max(box[1] - box[0], box[3] - box[2]) / params.cells
    laid = [_laid(view, box, cell_m, ground_m) for view in (one, other)]
    seen = np.isfinite(laid[0]) & np.isfinite(laid[1])
    if min(seen.shape) < params.cells // 4 or seen.mean() < params.least_filled:
        return None
    first, second = (np.where(seen, part - part[seen].mean(), 0.0).astype(np.float32) for part in laid)
    moved, peak = shift(first, second)
    return moved * cell_m if peak >= params.least_peak else None


def _laid(view: _View, box: FloatArray, cell_m: float, ground_m: float) -> FloatArray:
    """A picture on level ground (rows, columns), row 0 in the north; NaN where it does not show it."""
    east = np.arange(box[0] + cell_m / 2, box[1], cell_m)
    north = np.arange(box[3] - cell_m / 2, box[2], -cell_m)
    points = np.stack([*np.meshgrid(east, north), np.full((len(north), len(east)), ground_m)], axis=-1)
    pixels = view.camera.project_enu(points.reshape(-1, 3), view.pose) / view.scale - 0.5
    rows, columns = view.picture.shape
    with np.errstate(invalid="ignore"):
        inside = ((pixels >= 0.0) & (pixels <= [columns - 1, rows - 1])).all(axis=1)
    values = np.full(len(pixels), np.nan)
    values[inside] = map_coordinates(view.picture, pixels[inside].T[::-1], order=1)
    return values.reshape(len(north), len(east))

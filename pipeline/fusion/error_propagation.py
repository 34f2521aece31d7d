"""How sure a place is: first-order propagation of all errors through the least squares of ``localization``.

Two kinds of errors are kept apart. What all looks of a stream share (the offset of its satellite position, of
its compass and gimbal), what all looks at a place share (the terrain's height, the bias of the ground point,
the body's posture) moves them all together: a hundred looks do not average it away. What differs from look to
look (the wandering of pose, the box) does average, as far as it is not correlated in time.

Where the telemetry states how sure a pose is (the kind of fix, RTK, a course taken for a heading), that takes the
place of the mission's position_bias, height_bias or attitude_bias for this look, be it larger or smaller. Such an
error is taken to be wholly shared by the looks of its stream: a look that is twice as unsure moves twice as far.

A focal length that is wrong by the share e is one of the shared errors: it spreads or gathers all rays of a
stream about the optical axis. The ray (x, y, 1) of a camera, x = (u - cx) / fx, changes by -e (x, y, 0), which
is a small rotation of its direction. (What e does through the lens's distortion is of second order, left out.)

The second kind is also estimated from the scatter of the looks: its variance is multiplied by the variance
factor chi-square / degrees of freedom of the rays' residuals where that is above 1. So the larger of what was
predicted and what was observed counts (R. T. Birge, "The calculation of errors by the method of least
squares", Phys. Rev. 40, 1932; W. Förstner, B. P. Wrobel, "Photogrammetric Computer Vision", 2016, ch. 4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.config.uncertainty import Uncertainty
from pipeline.fusion.localization import GROUND_STD_M, RAYS_STD_M, Fix, solve
from pipeline.fusion.look import Look
from pipeline.messages import FloatArray

#: the scatter is taken from at most so many looks, evenly chosen: its covariance is a full matrix
_MOST_FOR_SCATTER = 150


@dataclass(frozen=True, eq=False)
class _Effects:
    """What a unit of each error of each look does to a quantity of k components.

    position: (N, k, 3) for metres east, north, up. attitude: (N, k, 3) for radians yaw, pitch, roll.
    box: (N, k, 3), for the direction of the rays, radians. focal: (N, k, 1), for the standard deviation of the
    focal length. times_s: (N,). streams: (N,), numbers. stated: (N, 6), standard deviations of east, north, up, yaw,
    pitch and roll that a look states itself; NaN where it does not.
    """

    position: FloatArray
    attitude: FloatArray
    box: FloatArray
    focal: FloatArray
    times_s: FloatArray
    streams: FloatArray
    stated: FloatArray


def place_covariance(looks: Sequence[Look], uncertainty: Uncertainty) -> FloatArray:
    """Covariance (2, 2) of east and north of ``locate``, square metres."""
    fix = solve(looks)
    effects = _effects_on_place(looks, fix)
    shared = _of_biases(effects, uncertainty) + _of_place(looks, fix, uncertainty)
    return np.asarray(shared + variance_factor(looks, uncertainty) * _of_noise(effects, uncertainty))


def variance_factor(looks: Sequence[Look], uncertainty: Uncertainty) -> float:
    """The observed over the predicted variance of the rays about their common point, at least 1.

    Biases explain their part of the scatter first, since streams with different offsets disagree.
    """
    chosen = _thinned(looks)
    rays = np.array([look.center_ray_enu for look in chosen])
    cameras = np.array([look.camera_enu for look in chosen])
    tangents = np.array([_tangents(ray) for ray in rays])
    effects = _effects_on_rays(chosen, solve(chosen).body_enu, tangents)
    half = np.linalg.cholesky(_joint(effects, uncertainty))
    design = np.linalg.solve(half, tangents.reshape(-1, 3))
    observed = np.linalg.solve(half, np.einsum("nki,ni->nk", tangents, cameras).reshape(-1))
    best, _, rank, _ = np.linalg.lstsq(design, observed, rcond=1e-9)
    freedom = 2 * len(chosen) - rank
    residual = observed - design @ best
    return max(1.0, float(residual @ residual) / freedom) if freedom else 1.0


def _thinned(looks: Sequence[Look]) -> list[Look]:
    if len(looks) <= _MOST_FOR_SCATTER:
        return list(looks)
    return [looks[i] for i in np.linspace(0, len(looks) - 1, _MOST_FOR_SCATTER).astype(int)]


def _effects_on_place(looks: Sequence[Look], fix: Fix) -> _Effects:
    """A ray moves at the body by the camera's error and by distance times angle; a ground point slides."""
    cameras = np.array([look.camera_enu for look in looks])
    center = np.array([look.center_ray_enu for look in looks])
    range_m = np.einsum("ni,ni->n", fix.body_enu - cameras, center)
    sight = np.array([look.intersection_enu for look in looks]) - cameras
    reach_m = np.linalg.norm(sight, axis=1)
    ground = fix.from_ground @ _slide(sight)
    turned = range_m[:, None, None] * fix.from_rays @ _turn(center)
    on_ground = reach_m[:, None, None] * ground @ _turn(sight / reach_m[:, None])
    focal = turned @ _spread(looks, center) + on_ground @ _spread(looks, sight)
    turned += on_ground
    axes = np.array([_gimbal_axes(look.enu_from_camera) for look in looks])
    pixel = np.array([look.pixel_rad for look in looks])[:, None, None]
    return _Effects(fix.from_rays + ground, turned @ axes, turned * pixel, focal, *_when_and_who(looks))


def _effects_on_rays(looks: Sequence[Look], body_enu: FloatArray, tangents: FloatArray) -> _Effects:
    """The same for the two coordinates of each ray across itself."""
    cameras = np.array([look.camera_enu for look in looks])
    center = np.array([look.center_ray_enu for look in looks])
    range_m = np.einsum("ni,ni->n", body_enu - cameras, center)
    turned = range_m[:, None, None] * tangents @ _turn(center)
    axes = np.array([_gimbal_axes(look.enu_from_camera) for look in looks])
    pixel = np.array([look.pixel_rad for look in looks])[:, None, None]
    focal = turned @ _spread(looks, center)
    return _Effects(tangents, turned @ axes, turned * pixel, focal, *_when_and_who(looks))


def _when_and_who(looks: Sequence[Look]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The last fields of _Effects."""
    first = min(look.time_ns for look in looks)
    names = sorted({look.stream for look in looks})
    times = np.array([(look.time_ns - first) * 1e-9 for look in looks])
    stated = [(k.horizontal_sd_m,) * 2 + (k.height_sd_m,) + (k.attitude_sd_rad,) * 3 for k in looks]
    streams = np.array([names.index(look.stream) for look in looks], dtype=np.float64)
    return times, streams, np.array(stated, dtype=np.float64)


def _of_biases(effects: _Effects, uncertainty: Uncertainty) -> FloatArray:
    """Each stream's looks move together."""
    total = np.zeros((2, 2))
    of_position, of_attitude, position2, attitude2 = _of_unit_bias(effects, uncertainty)
    for stream in np.unique(effects.streams):
        mine = effects.streams == stream
        position, attitude = of_position[mine].sum(axis=0), of_attitude[mine].sum(axis=0)
        focal = effects.focal[mine].sum(axis=0)
        total += position * position2 @ position.T + attitude * attitude2 @ attitude.T + focal @ focal.T
    return total


def _of_unit_bias(
    effects: _Effects, uncertainty: Uncertainty
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Effects of position and attitude (N, k, 3), and the variances (3,) of the biases that they are multiplied by.

    Where a look states its own deviations they are in its effects, and the variances are 1.
    """
    position2, attitude2 = _bias_variances(uncertainty)
    if np.isnan(effects.stated).all():
        return effects.position, effects.attitude, position2, attitude2
    of_mission = np.sqrt(np.concatenate([position2, attitude2]))
    sds = np.where(np.isnan(effects.stated), of_mission, effects.stated)[:, None, :]
    return effects.position * sds[..., :3], effects.attitude * sds[..., 3:], np.ones(3), np.ones(3)


def _bias_variances(uncertainty: Uncertainty) -> tuple[FloatArray, FloatArray]:
    """Of east, north, up (3,), square metres, and of yaw, pitch, roll (3,), square radians."""
    horizontal, vertical = uncertainty.position_bias**2, uncertainty.height_bias**2
    return np.array([horizontal, horizontal, vertical]), np.full(3, uncertainty.attitude_bias**2)


def _of_place(looks: Sequence[Look], fix: Fix, uncertainty: Uncertainty) -> FloatArray:
    """The terrain's height, the bias of the ground point, and the body, the same for all looks at a place."""
    sight = np.array([look.intersection_enu - look.camera_enu for look in looks])
    by_look = np.einsum("nij,nj->ni", fix.from_ground, sight / sight[:, 2:])
    raised = by_look.sum(axis=0)
    # what stands in for the surface model is off by the same for all looks that meet it
    stood_in = np.array([look.terrain_sd_m for look in looks]) @ by_look
    ground = fix.from_ground.sum(axis=0)
    return np.asarray(
        uncertainty.terrain**2 * np.outer(raised, raised)
        + np.outer(stood_in, stood_in)
        + GROUND_STD_M**2 * ground @ ground.T
        + uncertainty.body**2 * np.eye(2)
    )


def _of_noise(effects: _Effects, uncertainty: Uncertainty) -> FloatArray:
    """Pose noise is correlated in time within a stream, boxes are not."""
    total = uncertainty.box**2 * np.einsum("nij,nkj->ik", effects.box, effects.box)
    for stream in np.unique(effects.streams):
        mine = np.flatnonzero(effects.streams == stream)
        order = mine[np.argsort(effects.times_s[mine], kind="stable")]
        times = effects.times_s[order]
        for variance, effect in (
            (uncertainty.position_noise**2, effects.position[order]),
            (uncertainty.attitude_noise**2, effects.attitude[order]),
        ):
            total += variance * _markov(effect, times, uncertainty.correlation_time)
    return np.asarray(total)


def _markov(effect: FloatArray, times_s: FloatArray, correlation_time_s: float) -> FloatArray:
    """Sum over i and j of effect_i effect_j^T exp(-|t_i - t_j| / correlation time), in one pass."""
    total, past = np.zeros((2, 2)), np.zeros((2, 3))
    kept = np.exp(-np.diff(times_s, prepend=times_s[0]) / correlation_time_s)
    for now, keep in zip(effect, kept, strict=True):
        past = keep * past
        total += now @ now.T + now @ past.T + past @ now.T
        past = past + now
    return total


def _joint(effects: _Effects, uncertainty: Uncertainty) -> FloatArray:
    """Covariance (2N, 2N) of all rays' coordinates across themselves."""
    same = effects.streams[:, None] == effects.streams[None]
    lag_s = np.abs(effects.times_s[:, None] - effects.times_s[None])
    wander = same * np.exp(-lag_s / uncertainty.correlation_time)
    of_position, of_attitude, position2, attitude2 = _of_unit_bias(effects, uncertainty)
    position = np.einsum("nik,mjk,k->nimj", of_position, of_position, position2)
    attitude = np.einsum("nik,mjk,k->nimj", of_attitude, of_attitude, attitude2)
    focal = np.einsum("nik,mjk->nimj", effects.focal, effects.focal)
    total = same[:, None, :, None] * (position + attitude + focal)
    position = np.einsum("nik,mjk->nimj", effects.position, effects.position) * uncertainty.position_noise**2
    attitude = np.einsum("nik,mjk->nimj", effects.attitude, effects.attitude) * uncertainty.attitude_noise**2
    total = total + wander[:, None, :, None] * (position + attitude)
    size = 2 * len(effects.times_s)
    box = uncertainty.box**2 * np.einsum("nik,njk->nij", effects.box, effects.box)
    total[np.arange(size // 2), :, np.arange(size // 2)] += box
    return np.asarray(total.reshape(size, size) + RAYS_STD_M**2 * np.eye(size))


def _tangents(ray: FloatArray) -> FloatArray:
    """Two unit vectors (2, 3) across a ray and each other."""
    level = np.array([ray[1], -ray[0], 0.0])
    length = math.hypot(ray[0], ray[1])
    first = level / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    return np.stack([first, np.cross(ray, first)])


def _turn(rays: FloatArray) -> FloatArray:
    """Matrices (N, 3, 3): a small rotation vector to the change of a unit direction (N, 3)."""
    zero = np.zeros(len(rays))
    x, y, z = rays.T
    return np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)


def _spread(looks: Sequence[Look], rays: FloatArray) -> FloatArray:
    """Rotation vectors (N, 3, 1), radians, of rays (N, 3) for one standard deviation of the focal length."""
    forward = np.array([look.enu_from_camera[:, 2] for look in looks])
    sd = np.array([look.focal_sd for look in looks])[:, None]
    units = rays / np.linalg.norm(rays, axis=1)[:, None]
    along = np.einsum("ni,ni->n", units, forward)[:, None]
    # what is across the axis shrinks by its share; the rotation is the ray times (vector product) that change
    return np.asarray(sd * np.cross(units, along * forward - units))[:, :, None]


def _slide(sight: FloatArray) -> FloatArray:
    """Matrices (N, 3, 3): a shift of a line of sight (N, 3) to that of where it meets level ground."""
    up = np.array([0.0, 0.0, 1.0])
    return np.eye(3) - (sight / sight[:, 2:])[:, :, None] * up


def _gimbal_axes(enu_from_camera: FloatArray) -> FloatArray:
    """Axes (3, 3), columns, about which yaw (clockwise), pitch (up) and roll turn the camera."""
    forward = enu_from_camera[:, 2]
    length = math.hypot(forward[0], forward[1])
    right = np.array([forward[1], -forward[0], 0.0]) / length if length > 1e-9 else enu_from_camera[:, 0]
    return np.stack([np.array([0.0, 0.0, -1.0]), right, forward], axis=1)

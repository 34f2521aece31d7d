"""How the ground should move through the pictures, by the telemetry: patch for patch of a measured motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.geo.camera import Camera
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.ingest.checks.picture_motion import Motion
from pipeline.ingest.trajectory import Trajectory
from pipeline.messages import CameraPose, FloatArray

#: a fix that wanders less than this stands still, metres
_STILL_M = 0.3


@dataclass(frozen=True, slots=True)
class Assumption:
    """What may be wrong with a telemetry. clock_s: to be added to the video's time. yaw_rad: to every yaw.

    height_m: to every height. focal_scale: of the focal length. pitch_sign: 1 or -1.
    """

    clock_s: float = 0.0
    yaw_rad: float = 0.0
    height_m: float = 0.0
    focal_scale: float = 1.0
    pitch_sign: float = 1.0


class Predictor:
    """Predicts one stream's motion under assumptions; poses are kept by time."""

    def __init__(self, motion: Motion, trajectory: Trajectory, camera: Camera, terrain: Terrain) -> None:
        self.motion, self._trajectory, self._camera, self._terrain = motion, trajectory, camera, terrain
        self._poses: dict[float, CameraPose | None] = {}
        self._ground_m = float(np.nanmedian(terrain.heights_m[:: max(1, terrain.shape[0] // 64)]))

    @property
    def focal_px(self) -> float:
        """Focal length, in pixels that were compared."""
        return float(self._camera.fx) / self.motion.scale

    @property
    def is_still(self) -> bool:
        """Whether the telemetry says that the drone stays where it is."""
        return bool(np.ptp(self._trajectory.positions_enu[:, :2], axis=0).max() < _STILL_M)

    def displacement_px(self, assumed: Assumption) -> FloatArray:
        """(M, 2), pixels that were compared; NaN where there is no pose, infinite where no ground is in sight."""
        motion = self.motion
        first = self._placed(motion.first_s, assumed)
        second = self._placed(motion.second_s, assumed)
        rays = self._camera.rays(motion.from_px)
        rays[:, :2] /= assumed.focal_scale
        points = self._on_ground(first[0], np.einsum("nij,nj->ni", first[1], rays))
        seen = np.einsum("nji,nj->ni", second[1], points - second[0])
        seen[:, :2] *= assumed.focal_scale
        moved = np.asarray((self._camera.project(seen) - motion.from_px) / motion.scale)
        posed = np.isfinite(first[0]).all(axis=1) & np.isfinite(second[0]).all(axis=1)
        return np.where(np.asarray(posed)[:, None] & ~np.isfinite(moved), np.inf, moved)

    def _placed(self, times_s: FloatArray, assumed: Assumption) -> tuple[FloatArray, FloatArray]:
        """Positions (M, 3) and rotations (M, 3, 3), NaN without a pose."""
        moments, place = np.unique(times_s, return_inverse=True)  # the patches of a burst share their pose
        position, rotation = np.full((len(moments), 3), np.nan), np.full((len(moments), 3, 3), np.nan)
        for k, time_s in enumerate(moments.tolist()):
            pose = self._pose(time_s + assumed.clock_s)
            if pose is not None:
                position[k], rotation[k] = pose.position_enu, _turned(pose.enu_from_camera, assumed)
        position[:, 2] += assumed.height_m
        return position[place], rotation[place]

    def _pose(self, time_s: float) -> CameraPose | None:
        key = round(time_s, 4)
        if key not in self._poses:
            self._poses[key] = self._trajectory.pose(key)
        return self._poses[key]

    def _on_ground(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Where rays (M, 3) meet the ground: a plane at the height of the terrain there, found in a few steps."""
        height_m = np.full(len(origins), self._ground_m)
        for _ in range(3):
            with np.errstate(divide="ignore", invalid="ignore"):
                reach = (height_m - origins[:, 2]) / directions[:, 2]
            reach = np.where((reach > 0.0) & (directions[:, 2] < -1e-3), reach, np.nan)
            points = origins + reach[:, None] * directions
            cells = self._terrain.cells(points)
            inside = cells[:, 0] >= 0
            found = self._terrain.heights_m[cells[inside, 0], cells[inside, 1]]
            height_m[inside] = np.where(np.isfinite(found), found, height_m[inside])
        return np.asarray(points)


def _turned(rotation: FloatArray, assumed: Assumption) -> FloatArray:
    if assumed.pitch_sign < 0.0:
        yaw, pitch, roll = angles_of(rotation)
        rotation = enu_from_camera(yaw, -pitch, roll)
    if assumed.yaw_rad:
        c, s = math.cos(assumed.yaw_rad), math.sin(assumed.yaw_rad)
        # yaw is clockwise from north
        rotation = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ rotation
    return rotation


def angles_of(rotation: FloatArray) -> tuple[float, float, float]:
    """Yaw, pitch and roll (rad) of a rotation from the camera to ENU: the inverse of ``enu_from_camera``."""
    right, _, forward = rotation.T
    pitch = math.asin(max(-1.0, min(1.0, float(forward[2]))))
    if abs(forward[2]) > 1.0 - 1e-9:  # straight down: yaw and roll are one; all of it is yaw
        return math.atan2(-float(right[1]), float(right[0])), pitch, 0.0
    yaw = math.atan2(float(forward[0]), float(forward[1]))
    level_right = np.array([math.cos(yaw), -math.sin(yaw), 0.0])
    level_down = np.cross(forward, level_right)
    return yaw, pitch, math.atan2(float(right @ level_down), float(right @ level_right))

"""The camera model: pinhole with Brown-Conrady or rational distortion (OpenCV's)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from pipeline.geo.lens import before_the_fold, distorted, undistorted
from pipeline.messages import CameraPose, FloatArray


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole and what its lens does to straight lines.

    width, height: picture, pixels. fx, fy, cx, cy: pixels. distortion: float64 (5,) k1, k2, p1, p2, k3, or
    (8,) with k4, k5, k6 of the denominator too. focal_sd: standard deviation of the focal length, as a share of
    it, the same for all pictures; 0 where the camera was calibrated.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: FloatArray = field(default_factory=lambda: np.zeros(5))
    focal_sd: float = 0.0

    def zoomed(self, scale: float) -> Camera:
        """The camera with its focal length times scale; the same object each time, this one at scale 1.

        As a crop enlarges: about the middle of the picture, each ray bent as before. What an optical zoom
        does to a lens's distortion beside that is not known.
        """
        return self if scale == 1.0 else _zoomed(self, scale)

    def project(self, points_camera: FloatArray) -> FloatArray:
        """Pixels (N, 2) of points (N, 3) in the camera frame; NaN for points not in front of the camera.

        NaN too where the lens model has folded: it would show what is far aside in the middle of the picture.
        """
        z = np.where(points_camera[:, 2] > 1e-9, points_camera[:, 2], np.nan)
        x, y = points_camera[:, 0] / z, points_camera[:, 1] / z
        if any(self.distortion.tolist()):
            inside = before_the_fold(self.distortion, x, y)
            x, y = distorted(self.distortion, x, y)
            x, y = np.where(inside, x, np.nan), np.where(inside, y, np.nan)
        return np.stack([x * self.fx + self.cx, y * self.fy + self.cy], axis=1)

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Directions (N, 3) in the camera frame with z = 1, of pixels (N, 2): the inverse of project.

        NaN where the lens model cannot be inverted; never inside the picture of a camera that passed
        ``pipeline.geo.lens.fold_radius_px``.
        """
        xd = (pixels[:, 0] - self.cx) / self.fx
        yd = (pixels[:, 1] - self.cy) / self.fy
        x, y = undistorted(self.distortion, xd, yd) if any(self.distortion.tolist()) else (xd, yd)
        rays = np.ones((len(pixels), 3))
        rays[:, 0], rays[:, 1] = x, y
        return rays

    def project_enu(self, points_enu: FloatArray, pose: CameraPose) -> FloatArray:
        """Pixels (N, 2) of points (N, 3) in the map frame, at the focal length of the pose."""
        at_pose = self.zoomed(pose.focal_scale)
        return at_pose.project((points_enu - pose.position_enu) @ pose.enu_from_camera)

    def rays_enu(self, pixels: FloatArray, pose: CameraPose) -> FloatArray:
        """Unit directions (N, 3) in the map frame of pixels (N, 2), at the focal length of the pose."""
        rays: FloatArray = self.zoomed(pose.focal_scale).rays(pixels) @ pose.enu_from_camera.T
        rays /= np.sqrt(np.einsum("ij,ij->i", rays, rays))[:, None]
        return rays


@lru_cache(maxsize=256)
def _zoomed(camera: Camera, scale: float) -> Camera:
    middle_x, middle_y = camera.width / 2.0, camera.height / 2.0
    return replace(
        camera,
        fx=camera.fx * scale,
        fy=camera.fy * scale,
        cx=middle_x + scale * (camera.cx - middle_x),
        cy=middle_y + scale * (camera.cy - middle_y),
    )

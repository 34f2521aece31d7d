"""The camera model: pinhole with Brown-Conrady distortion (OpenCV's)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pipeline.messages import CameraPose, FloatArray


@dataclass(frozen=True, eq=False)
class Camera:
    """width, height: picture, pixels. fx, fy, cx, cy: pixels. distortion: float64 (5,) k1, k2, p1, p2, k3."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: FloatArray = field(default_factory=lambda: np.zeros(5))

    def project(self, points_camera: FloatArray) -> FloatArray:
        """Pixels (N, 2) of points (N, 3) in the camera frame; NaN for points not in front of the camera."""
        z = np.where(points_camera[:, 2] > 1e-9, points_camera[:, 2], np.nan)
        x, y = self._distort(points_camera[:, 0] / z, points_camera[:, 1] / z)
        return np.stack([x * self.fx + self.cx, y * self.fy + self.cy], axis=1)

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Directions (N, 3) in the camera frame with z = 1, of pixels (N, 2): the inverse of project."""
        xd = (pixels[:, 0] - self.cx) / self.fx
        yd = (pixels[:, 1] - self.cy) / self.fy
        x, y = xd, yd
        if any(self.distortion.tolist()):
            for _ in range(20):
                xt, yt = self._distort(x, y)
                x, y = x + (xd - xt), y + (yd - yt)
        rays = np.ones((len(pixels), 3))
        rays[:, 0], rays[:, 1] = x, y
        return rays

    def project_enu(self, points_enu: FloatArray, pose: CameraPose) -> FloatArray:
        """Pixels (N, 2) of points (N, 3) in the map frame."""
        return self.project((points_enu - pose.position_enu) @ pose.enu_from_camera)

    def rays_enu(self, pixels: FloatArray, pose: CameraPose) -> FloatArray:
        """Unit directions (N, 3) in the map frame of pixels (N, 2)."""
        rays: FloatArray = self.rays(pixels) @ pose.enu_from_camera.T
        rays /= np.sqrt(np.einsum("ij,ij->i", rays, rays))[:, None]
        return rays

    def _distort(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )

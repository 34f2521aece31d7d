"""The owner of the map: applies one result after the other (alg:grid_update).

Readings taken where the paper is open:

- The voxels that a frame's detections raise belong to its boxes, so the same frame does not lower them,
  although their centres may project just below the box.
- A box cut by the picture's border has neither a known size nor a known significant point: it raises nothing,
  and what lies behind it is still not lowered.
- What lies behind a box is not observed, whatever the box's class; a class without a layer raises nothing.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.config.mission import Fusion
from pipeline.errors import InputError
from pipeline.fusion.look import Look
from pipeline.fusion.sensor_model import SensorModel
from pipeline.fusion.visibility import visible_cells
from pipeline.fusion.voxel_map import VoxelMap, log_odds
from pipeline.geo.camera import Camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections, FloatArray

#: A box whose edge is this near to the picture's border counts as cut by it.
_BORDER_PX = 2.0


class Fuser:
    """Raises the voxels of detections and lowers those seen without one.

    maps: a VoxelMap per class name; map: that of persons. looks: the detections that raised them, in order.
    refused: bad input by reason, which
    left the map as it was. unplaced: good boxes without a valid voxel or with an impossible size, by reason;
    they raised nothing.
    """

    def __init__(
        self,
        terrain: Terrain,
        params: Fusion,
        cameras: Mapping[str, Camera],
        relative_accuracy: Mapping[str, float],
        folder: Path | None = None,
    ) -> None:
        """cameras: by stream. relative_accuracy: p_det^rel in 0..1 by detector, else InputError.

        folder: where the maps may put what does not fit into memory.
        """
        for detector, accuracy in relative_accuracy.items():
            if not 0.0 <= accuracy <= 1.0:
                raise InputError(f"relative accuracy of {detector}", f"{accuracy:g}", "a number in 0..1")
        self._classes = {c.id: c for c in params.classes}
        self.maps = {
            c.name: VoxelMap(terrain, params.clamp_min, params.clamp_max, folder) for c in params.classes
        }
        self.map = self.maps[params.classes[0].name]
        self.looks: list[Look] = []
        self.refused: Counter[str] = Counter()
        self.unplaced: Counter[str] = Counter()
        self._terrain, self._params = terrain, params
        self._cameras, self._p_detector = dict(cameras), dict(relative_accuracy)
        self._models = {
            (stream, c.name): SensorModel(camera, params, c)
            for stream, camera in cameras.items()
            for c in params.classes
        }

    def apply(self, detections: Detections) -> None:
        """Apply one frame's result: first what it raises, then what it lowers.

        Bad input is counted in ``refused`` and leaves the map as it was.
        """
        reason = self._fault(detections)
        if reason is not None:
            self.refused[reason] += 1
            return
        sound = self._sound_boxes(detections)
        placed = [self._look(detections, i) for i in sound]
        self.unplaced.update(reason for reason in placed if isinstance(reason, str))
        looks = [look for look in placed if isinstance(look, Look)]
        for name, voxel_map in self.maps.items():
            mine = [look for look in looks if look.class_name == name]
            _raise(voxel_map, mine)
            self._observe(voxel_map, name, detections, detections.boxes_px[sound], mine)
        self.looks += looks

    def _fault(self, detections: Detections) -> str | None:
        """Why nothing of a result can be used, if so."""
        if detections.stream not in self._cameras:
            return "unknown stream"
        if detections.detector not in self._p_detector:
            return "unknown detector"
        n = len(detections.boxes_px)
        if detections.boxes_px.shape != (n, 4) or detections.scores.shape != (n,):
            return "boxes and scores of different number"
        if detections.class_ids.shape != (n,):
            return "boxes and classes of different number"
        return self._pose_fault(detections.pose)

    def _pose_fault(self, pose: CameraPose) -> str | None:
        rotation = pose.enu_from_camera
        if not (np.isfinite(pose.position_enu).all() and np.isfinite(rotation).all()):
            return "pose with NaN"
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0.0:
            return "attitude that is no rotation"
        if self._terrain.cells(pose.position_enu[None])[0, 0] < 0:
            return "pose outside the terrain"
        ground = self._terrain.height(float(pose.position_enu[0]), float(pose.position_enu[1]))
        if pose.position_enu[2] <= ground:
            return "pose under the ground"
        return None

    def _sound_boxes(self, detections: Detections) -> list[int]:
        """Numbers of the boxes that can be used."""
        sound = []
        for i, (box, score) in enumerate(zip(detections.boxes_px, detections.scores, strict=True)):
            reason = _box_fault(box, float(score), self._cameras[detections.stream])
            if reason is None:
                sound.append(i)
            else:
                self.refused[reason] += 1
        return sound

    def _look(self, detections: Detections, i: int) -> Look | str:
        """Where box i stands and how much it says, or why it has no place."""
        box, camera = detections.boxes_px[i], self._cameras[detections.stream]
        object_class = self._classes.get(int(detections.class_ids[i]))
        if object_class is None:
            return "class without a layer"
        if _is_cut(box, camera):
            return "cut by the picture's border"
        model, position = self._models[detections.stream, object_class.name], detections.pose.position_enu
        center = (box[:2] + box[2:]) / 2.0
        at_center = object_class.significant_point == "center"
        significant = center if at_center else np.array([center[0], box[3]])
        rays = camera.rays_enu(np.stack([significant, center]), detections.pose)
        hit = self._terrain.intersect(position, rays[0], model.reach_m)
        if hit is None:
            return "no ground within reach"
        row, column = (int(k) for k in self._terrain.cells(hit[None])[0])
        if not self.map.valid(row, column):
            return "no voxel"
        score, p_detector = float(detections.scores[i]), self._p_detector[detections.detector]
        p = model.positive(box, score, math.dist(hit, position), p_detector)
        if p <= 0.5:
            return "not the size of its class, or no trust"
        return Look(
            detections.time_ns,
            detections.stream,
            detections.detector,
            score,
            p,
            row,
            column,
            hit,
            position,
            rays[1],
            detections.pose.enu_from_camera,
            1.0 / math.sqrt(camera.fx * camera.fy),
            object_class.name,
        )

    def _observe(
        self,
        voxel_map: VoxelMap,
        name: str,
        detections: Detections,
        boxes_px: FloatArray,
        looks: list[Look],
    ) -> None:
        """negativeUpdate of Algorithm grid_update."""
        model = self._models[detections.stream, name]
        rows, columns, distances = visible_cells(
            self._terrain,
            self._cameras[detections.stream],
            detections.pose,
            model.max_distance_m,
            boxes_px,
        )
        p_detector = self._p_detector[detections.detector]
        seen = np.stack([rows, columns])
        voxel_map.observe(seen, distances, _cells(looks), model, p_detector, detections.time_ns)


def _cells(looks: list[Look]) -> NDArray[np.int64]:
    """Rows and columns (2, N) of the looks' voxels."""
    return np.array([[k.row for k in looks], [k.column for k in looks]], dtype=np.int64)


def _raise(voxel_map: VoxelMap, looks: list[Look]) -> None:
    """positiveUpdate of Algorithm grid_update."""
    voxel_map.update(*_cells(looks), log_odds(np.array([look.p for look in looks], dtype=np.float64)))


def _box_fault(box: FloatArray, score: float, camera: Camera) -> str | None:
    """Why one box can not be used, if so."""
    if not np.isfinite(box).all():
        return "box with NaN"
    if box[2] <= box[0] or box[3] <= box[1]:
        return "box without area"
    if box[2] <= 0.0 or box[3] <= 0.0 or box[0] >= camera.width or box[1] >= camera.height:
        return "box outside the picture"
    if not 0.0 <= score <= 1.0:
        return "score outside 0..1"
    return None


def _is_cut(box: FloatArray, camera: Camera) -> bool:
    low, high = _BORDER_PX, (camera.width - _BORDER_PX, camera.height - _BORDER_PX)
    return bool(box[0] < low or box[1] < low or box[2] > high[0] or box[3] > high[1])

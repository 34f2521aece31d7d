"""The owner of the map: applies one result after the other (alg:grid_update).

Readings taken where the paper is open:

- The voxels that a frame's detections raise belong to its boxes, so the same frame does not lower them,
  although their centres may project just below the box.
- A box cut by the picture's border has neither a known size nor a known significant point: it raises nothing,
  and what lies behind it is still not lowered. Nor does a frame lower a place where an object would be cut by
  the border: what cannot speak for a place must not speak against it. (Else a person who was found in a
  hundred frames is gone after ten that show the feet alone.)
- What lies behind a box is not observed, whatever the box's class; a class without a layer raises nothing.
"""

from __future__ import annotations

import math
from bisect import insort
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.config.fusion import Fusion
from pipeline.config.uncertainty import EXACT
from pipeline.errors import InputError
from pipeline.fusion.footprint import NO_FOOTPRINTS, Footprints, footprints
from pipeline.fusion.look import Look
from pipeline.fusion.look_covariance import look_covariances
from pipeline.fusion.optics import Optics, OpticsByFocalLength
from pipeline.fusion.result_faults import box_fault, is_cut, pose_fault, shape_fault
from pipeline.fusion.viewpoints import Viewpoints
from pipeline.fusion.visibility import Visibility
from pipeline.fusion.voxel_map import VoxelMap, log_odds
from pipeline.geo.camera import Camera
from pipeline.geo.terrain import Terrain
from pipeline.ingest.checks.box_sizes import size_bin
from pipeline.messages import CameraPose, Detections, FloatArray
from pipeline.sensor.expected_size import expected_person_px
from pipeline.sensor.model import SensorModel
from pipeline.sensor.substream import SubstreamModel, found_by_distance

#: score of a box that a person's size may be read from
_SURE = 0.5
_NO_BOXES = np.zeros((0, 4))
#: distances in a table of the probability of being found
_STEPS = 512
_NO_WIDTHS = np.zeros((0, 2, 2)), np.zeros((0, 2, 2))


class Fuser:
    """Raises the voxels of detections and lowers those seen without one.

    maps: a VoxelMap per class name; map: that of persons. looks: the detections that raised them, in the
    order of time, stream and detector. refused: bad input by reason, which left the map as it was. unplaced:
    good boxes without a valid voxel or with an impossible size, by reason; they raised nothing. sizes: of sure boxes
    of people against the size of a person at their place, (stream, ``size_bin``) -> count. last_ns: capture time
    of the last result of each stream and detector, ns UTC.
    """

    def __init__(
        self,
        terrain: Terrain,
        params: Fusion,
        cameras: Mapping[str, Camera],
        relative_accuracy: Mapping[str, float],
        folder: Path | None = None,
        owned: NDArray[np.bool_] | None = None,
        substreams: Mapping[tuple[str, str], SubstreamModel] | None = None,
    ) -> None:
        """cameras: by stream. relative_accuracy: p_det^rel in 0..1 by detector, else InputError. substreams: by
        stream and detector, what each is worth at its bitrate, in place of relative_accuracy, at the plan's epoch 0;
        not for the paper's rule.

        folder: where the maps may put what does not fit into memory. owned: the tiles that this fuser keeps,
        see sharding; all if absent.
        """
        for detector, accuracy in relative_accuracy.items():
            if not 0.0 <= accuracy <= 1.0:
                raise InputError(f"relative accuracy of {detector}", f"{accuracy:g}", "a number in 0..1")
        self._classes = {c.id: c for c in params.classes}
        self.maps = {
            c.name: VoxelMap(terrain, params.clamp_min, params.clamp_max, folder, owned)
            for c in params.classes
        }
        self.map = self.maps[params.classes[0].name]
        self.looks: list[Look] = []
        self.refused: Counter[str] = Counter()
        self.unplaced: Counter[str] = Counter()
        self.sizes: Counter[tuple[str, int]] = Counter()
        self._visibility = Visibility(terrain, owned)
        self._terrain = terrain
        self._cameras, self._p_detector = dict(cameras), dict(relative_accuracy)
        self._optics = {stream: OpticsByFocalLength(camera, params) for stream, camera in cameras.items()}
        paper = params.update_rule == "paper"
        self._uncertainty = EXACT if paper else params.uncertainty
        self._paper = paper
        self._substreams = {} if paper else {(*key, 0): worth for key, worth in (substreams or {}).items()}
        self._found: dict[tuple[str, str, int, str], FloatArray | None] = {}
        self.last_ns: dict[tuple[str, str], int] = {}
        self.viewpoints = Viewpoints(cameras)

    def learn(self, stream: str, detector: str, epoch: int, relative: float, worth: SubstreamModel) -> None:
        """What a substream that is opened at a later epoch is worth; see __init__."""
        self._p_detector.setdefault(detector, relative)
        if not self._paper:
            self._substreams[stream, detector, epoch] = worth

    def apply(self, detections: Detections) -> None:
        """Apply one frame's result: first what it raises, then what it lowers.

        Bad input is counted in ``refused`` and leaves the map as it was.
        """
        reason = self._fault(detections)
        if reason is not None:
            self.refused[reason] += 1
            return
        sound = self._sound_boxes(detections)
        looks = self._looks(detections, sound) if sound else []
        boxes_px = detections.boxes_px[sound] if sound else _NO_BOXES
        viewpoint = self.viewpoints.of_frame(
            detections.stream, detections.time_ns, detections.pose.position_enu
        )
        share, widths = self._share_that_counts(detections), self._widths(detections, looks)
        for name, voxel_map in self.maps.items():
            mine = [i for i, look in enumerate(looks) if look.class_name == name]
            wide = self._footprints(looks, mine, widths)
            raised = [looks[i] for i in mine if wide is not NO_FOOTPRINTS or self._owns(looks[i])]
            cells = np.array([[k.row for k in raised], [k.column for k in raised]], dtype=np.int64)
            if raised and wide is NO_FOOTPRINTS:
                voxel_map.update(cells[0], cells[1], share * log_odds(np.array([k.p for k in raised])))
            distances_m = np.array([math.dist(k.intersection_enu, k.camera_enu) for k in raised])
            self._observe(voxel_map, name, detections, boxes_px, (cells, distances_m), wide, share, viewpoint)
        vague = self._vague(widths)
        if vague.any():
            self.unplaced["known too badly where"] += int(vague.sum())
        self._keep([look for look, bad in zip(looks, vague, strict=True) if self._owns(look) and not bad])

    def _owns(self, look: Look) -> bool:
        return self.map.tiles.owns(look.row, look.column)

    def _widths(self, detections: Detections, looks: list[Look]) -> tuple[FloatArray, FloatArray]:
        """Noise and total covariances (N, 2, 2) of the looks."""
        if not looks:
            return _NO_WIDTHS
        optics, points = self._optics_of(detections), np.array([look.intersection_enu for look in looks])
        # what the telemetry states of its own errors is no part of the paper's rule either
        pose = _exact(detections.pose) if self._paper else detections.pose
        return look_covariances(points, pose, self._uncertainty, optics.pixel_rad, optics.camera.focal_sd)

    def _vague(self, widths: tuple[FloatArray, FloatArray]) -> NDArray[np.bool_]:
        """Which looks (N,) are known too badly to raise anything."""
        noise = widths[0]
        return np.asarray(np.linalg.eigvalsh(noise)[:, 1] > self._uncertainty.widest_look**2)

    def _footprints(
        self, looks: list[Look], mine: list[int], widths: tuple[FloatArray, FloatArray]
    ) -> Footprints:
        """Where some of the looks may raise the map; none if all is known exactly, or there are none."""
        noise, total = widths[0][mine], widths[1][mine]
        if not total.any():
            return NO_FOOTPRINTS
        points = np.array([looks[i].intersection_enu for i in mine])
        p = np.array([looks[i].p for i in mine])
        return footprints(self._terrain, points, noise, total, np.where(self._vague((noise, total)), 0.5, p))

    def _share_that_counts(self, detections: Detections) -> float:
        """Of a frame's evidence: the effective number of looks of a series whose errors are correlated.

        Frames of one substream at a distance of t seconds share what hides a person, or looks like one, with the
        correlation r = exp(-t / cause_time): n of them are worth n (1 - r) / (1 + r) looks (the effective sample
        size of an AR(1) series; G. V. Bayley, J. M. Hammersley, 1946). The first of a substream counts whole.
        """
        before = self.last_ns.get((detections.stream, detections.detector))
        self.last_ns[detections.stream, detections.detector] = detections.time_ns
        cause_s = self._uncertainty.cause_time
        if before is None or cause_s == 0.0:
            return 1.0
        return math.tanh(abs(detections.time_ns - before) * 1e-9 / (2.0 * cause_s))

    def _optics_of(self, detections: Detections) -> Optics:
        return self._optics[detections.stream].at(detections.pose.focal_scale)

    def _keep(self, looks: list[Look]) -> None:
        late = bool(looks and self.looks) and looks[0].order < self.looks[-1].order
        if not late:
            self.looks += looks
            return
        for look in looks:
            insort(self.looks, look, key=lambda kept: kept.order)

    def _fault(self, detections: Detections) -> str | None:
        """Why nothing of a result can be used, if so."""
        if detections.stream not in self._optics:
            return "unknown stream"
        if detections.detector not in self._p_detector:
            return "unknown detector"
        return shape_fault(detections) or pose_fault(detections.pose, self._terrain)

    def _sound_boxes(self, detections: Detections) -> list[int]:
        """Numbers of the boxes that can be used."""
        sound, camera = [], self._optics_of(detections).camera
        boxes, scores = detections.boxes_px.tolist(), detections.scores.tolist()
        for i, (box, score) in enumerate(zip(boxes, scores, strict=True)):
            reason = box_fault(box, score, camera)
            if reason is None:
                sound.append(i)
            else:
                self.refused[reason] += 1
        return sound

    def _looks(self, detections: Detections, sound: list[int]) -> list[Look]:
        """Where the boxes stand and how much they say; those without a place are counted."""
        boxes = detections.boxes_px[sound].tolist()
        pixels = [((x0 + x1) / 2.0, (y0 + y1) / 2.0) for x0, y0, x1, y1 in boxes]
        pixels += [((x0 + x1) / 2.0, y1) for x0, _, x1, y1 in boxes]
        rays = self._cameras[detections.stream].rays_enu(np.array(pixels), detections.pose)
        looks = []
        for i, to_center, to_bottom in zip(sound, rays[: len(sound)], rays[len(sound) :], strict=True):
            look = self._look(detections, i, to_center, to_bottom)
            if isinstance(look, str):
                self.unplaced[look] += 1
            else:
                looks.append(look)
        return looks

    def _look(
        self, detections: Detections, i: int, to_center: FloatArray, to_bottom: FloatArray
    ) -> Look | str:
        """Where box i stands and how much it says, or why it has no place. to_*: rays (3,), map frame."""
        box, position = detections.boxes_px[i].tolist(), detections.pose.position_enu
        optics, object_class = self._optics_of(detections), self._classes.get(int(detections.class_ids[i]))
        score = float(detections.scores[i])
        if object_class is None:
            return "class without a layer"
        if is_cut(box, optics.camera):
            return "cut by the picture's border"
        model = optics.models[object_class.name]
        ray = to_center if object_class.significant_point == "center" else to_bottom
        hit = self._terrain.intersect(position, ray, model.reach_m)
        if hit is None:
            return "no ground within reach"
        if score >= _SURE and object_class.name == "person":
            self._measure(detections, box, hit, ray)
        row, column = self._terrain.cell(float(hit[0]), float(hit[1]))
        if not self.map.valid(row, column):
            return "no voxel"
        p_detector = self._worth(detections).raises
        p = model.positive(box, score, math.dist(hit, position), p_detector)
        if p <= 0.5:
            return "not the size of its class, or no trust"
        time_ns, stream, detector = detections.order
        return Look(
            time_ns,
            stream,
            detector,
            score,
            p,
            row,
            column,
            hit,
            position,
            to_center,
            detections.pose.enu_from_camera,
            optics.pixel_rad,
            object_class.name,
            i,
            detections.pose.horizontal_sd_m,
            detections.pose.height_sd_m,
            detections.pose.attitude_sd_rad,
            optics.camera.focal_sd,
            self._terrain.extra_sd_m(row, column),
            self._worth(detections).trust,
        )

    def _measure(self, detections: Detections, box: list[float], hit: FloatArray, ray: FloatArray) -> None:
        """Count a box's size against that of a standing person where it stands."""
        down_rad = math.asin(max(-1.0, min(1.0, -float(ray[2]))))
        above_m = math.dist(hit, detections.pose.position_enu) * math.sin(down_rad)
        camera = self._optics_of(detections).camera
        expected_px = expected_person_px(above_m, -down_rad, math.sqrt(camera.fx * camera.fy))
        measured_px = math.sqrt((box[2] - box[0]) * (box[3] - box[1]))
        if expected_px > 0.0 and measured_px > 0.0:
            self.sizes[detections.stream, size_bin(measured_px, expected_px)] += 1

    def _observe(
        self,
        voxel_map: VoxelMap,
        name: str,
        detections: Detections,
        boxes_px: FloatArray,
        raised: tuple[NDArray[np.int64], FloatArray],
        wide: Footprints,
        share: float,
        viewpoint: int,
    ) -> None:
        """negativeUpdate of Algorithm grid_update. raised: rows and columns (2, N), and distances (N,)."""
        camera, optics = self._cameras[detections.stream], self._optics_of(detections)
        model, p_detector = optics.models[name], self._worth(detections).lowers
        seen, distances_m = self._visibility.cells(
            camera, detections.pose, optics.reach_m, boxes_px, model.typical_height_m
        )
        voxel_map.observe(
            seen, distances_m, *raised, model, p_detector, detections.time_ns, wide, share,
            self._found_by_distance(detections, model), viewpoint,
        )  # fmt: skip

    def _worth(self, detections: Detections) -> SubstreamModel:
        """Of the detections' substream."""
        known = self._substreams.get((detections.stream, detections.detector, detections.epoch))
        if known is not None:
            return known
        relative = self._p_detector[detections.detector]
        return SubstreamModel(relative, relative)

    def _found_by_distance(self, detections: Detections, model: SensorModel) -> FloatArray | None:
        """See VoxelMap.observe. One table for every zoom: at a share of the greatest distance, which grows with the
        focal length, people are as large in the picture.
        """
        key = (detections.stream, detections.detector, detections.epoch, model.object_class.name)
        if key not in self._found:
            distances_m = np.linspace(0.0, model.max_distance_m, _STEPS)
            width = self._optics_of(detections).camera.width
            self._found[key] = found_by_distance(
                self._worth(detections), model.typical_px_m, width, distances_m
            )
        return self._found[key]


def _exact(pose: CameraPose) -> CameraPose:
    """The pose as if nothing were known of its errors."""
    nothing = math.nan
    return replace(pose, horizontal_sd_m=nothing, height_sd_m=nothing, attitude_sd_rad=nothing)

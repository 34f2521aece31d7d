"""How large people are to the networks that look for them, and how likely one frame finds them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.allocation.plan import Assignment, Plan
from pipeline.geo.camera import Camera
from pipeline.ingest.finding import Finding
from pipeline.messages import CameraPose, FloatArray
from pipeline.mission.local import substream_models
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.proportions import middles
from pipeline.sensor.expected_size import PERSON_HEIGHT_M, PERSON_WIDTH_M, expected_person_px
from pipeline.sensor.substream import SubstreamModel

#: less of a chance in one frame is worth a warning; where the chance was not measured, fewer pixels of height are
_LOW_POD, _FEW_PX = 0.3, 12.0


@dataclass(frozen=True)
class PersonInNetwork:
    """How a person in the middle of a stream's pictures looks to a detector of the plan: the median over its seconds.

    distance_m: from the camera. network_px: height in pixels of the network's input. pod: probability that one frame
    finds the person, 0..1, as measured; None where the pool does not know it.
    """

    stream: str
    detector: str
    distance_m: float
    network_px: float
    pod: float | None

    @property
    def is_hard(self) -> bool:
        """Whether the person is hard to find."""
        return self.network_px < _FEW_PX if self.pod is None else self.pod < _LOW_POD

    @property
    def sentence(self) -> str:
        """For people."""
        chance = "was not measured" if self.pod is None else f"is {self.pod:.1f}"
        return (
            f"at {self.distance_m:.0f} m a person is {self.network_px:.0f} pixels high in the network of "
            f"{self.detector}; its probability of detection in one frame {chance}"
        )


def people_in_networks(prepared: PreparedMission, plan: Plan) -> list[PersonInNetwork]:
    """For every substream whose camera sees ground in the middle of its pictures and whose network is known."""
    known = {d.id for d in prepared.pool.detectors if d.id in prepared.input_sizes}
    worth = substream_models(prepared, plan) if known else {}
    found = []
    for stream in prepared.streams:
        camera = prepared.cameras[stream.stream]
        seen = middles(stream, camera, prepared.terrain)
        for a in (a for a in plan.assignments if a.stream == stream.stream):
            if seen and a.pool_detector in known:
                found.append(_in_network(prepared, a, camera, seen, worth[a.stream, a.detector]))
    return found


def check_networks(prepared: PreparedMission, plan: Plan) -> list[Finding]:
    """A warning for every substream in which a person is hard to find."""
    return [
        Finding(
            "warning",
            "small_in_network",
            f"stream {p.stream}",
            p.sentence,
            "",
            "fly lower, a longer focal length, or a detector that looks at tiles",
        )
        for p in people_in_networks(prepared, plan)
        if p.is_hard
    ]


def _in_network(
    prepared: PreparedMission,
    assignment: Assignment,
    camera: Camera,
    seen: Sequence[tuple[CameraPose, FloatArray]],
    worth: SubstreamModel,
) -> PersonInNetwork:
    distances, heights, roots = [], [], []
    for pose, hit in seen:
        distance_m, above_m = math.dist(pose.position_enu, hit), float(pose.position_enu[2] - hit[2])
        down = math.asin(max(-1.0, min(1.0, above_m / distance_m)))
        across_m = PERSON_HEIGHT_M * abs(math.cos(down)) + PERSON_WIDTH_M * abs(math.sin(down))
        focal_px = camera.fy * pose.focal_scale
        distances.append(distance_m)
        heights.append(focal_px * across_m / distance_m)
        roots.append(expected_person_px(above_m, -down, focal_px))
    distance_m = float(np.median(distances))
    measured = worth.probability_found(np.array([float(np.median(roots))]), camera.width)
    scale = _scale(prepared.input_sizes[assignment.pool_detector], assignment, camera)
    return PersonInNetwork(
        assignment.stream,
        assignment.pool_detector,
        distance_m,
        float(np.median(heights)) * scale,
        None if measured is None else float(measured[0]),
    )


def _scale(size: tuple[int, int] | None, assignment: Assignment, camera: Camera) -> float:
    """Pixels of a network's input for each pixel of the picture: of its height, where the sides differ."""
    if size is None:
        return 1.0
    tiling = assignment.setup.tiling
    width, height = (camera.width, camera.height) if tiling is None else (tiling.width, tiling.height)
    return min(size[0] / width, size[1] / height)

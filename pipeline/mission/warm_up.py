"""What a reducer compiles before it takes results: the first of them must not wait for that, nor it look dead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.allocation.plan import Plan
from pipeline.messages import Detections, pack, unpack
from pipeline.mission.local import make_reducer
from pipeline.mission.prepared import PreparedMission

#: boxes (N, 4) of the results that are taken, pixels from the middle of the picture
_BOXES = (np.zeros((0, 4)), np.array([[-15.0, -30.0, 15.0, 30.0], [-60.0, -30.0, -30.0, 30.0]]))


def warm_up(prepared: PreparedMission, plan: Plan) -> None:
    """Take results as they come from the wire, into a map that is thrown away.

    Numba keeps what it compiles on the disk, by the types of the arguments: an array that was read from a message
    cannot be written, and is another type than one that was made here.
    """
    stream = prepared.streams[0]
    pose = stream.trajectory.pose(stream.trajectory.span_s[0])
    assert pose is not None  # there is one at every sample
    detector = next(a.detector for a in plan.assignments if a.stream == stream.stream)
    camera = prepared.cameras[stream.stream]
    middle = np.array([camera.width / 2.0, camera.height / 2.0] * 2)
    scratch = make_reducer(replace(prepared, onto=None), plan, lateness=False).fuser
    for index, boxes in enumerate(_BOXES):
        result = Detections(
            stream=stream.stream,
            detector=detector,
            index=index,
            time_ns=stream.start_ns + index * 100_000_000,
            pose=pose,
            boxes_px=boxes + middle,
            scores=np.full(len(boxes), 0.9),
            class_ids=np.zeros(len(boxes), dtype=np.int64),
        )
        message = unpack(pack(result))
        assert isinstance(message, Detections)
        scratch.apply(message)

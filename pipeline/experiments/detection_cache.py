"""Detections of a mission, kept in a file: they depend on videos, models and plan, not on how they are fused.

The poses in them are those of the telemetry at hand, so that one video serves for many telemetries.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgpack

from pipeline.allocation.plan import Plan
from pipeline.errors import ProtocolError
from pipeline.messages import Detections, Message, pack, unpack
from pipeline.mission.local import process
from pipeline.mission.planning import plan
from pipeline.mission.prepared import PreparedMission
from pipeline.storage.code_digest import code_sha256
from pipeline.storage.whole_or_nothing import write_bytes

#: the code that boxes depend on
_CODE = (
    "pipeline.config.layout",
    "pipeline.detection",
    "pipeline.ingest.video",
    "pipeline.link",
    "pipeline.mission",
)
#: name of what is under way, steps done, steps in all
Progress = Callable[[str, int, int], None]


def detections_of(prepared: PreparedMission, cache: Path, progress: Progress) -> list[Detections]:
    """All results of the mission's plan in the order in which they are applied to the map.

    cache: a file that is read if it was made from the same videos, models and plan, else made.
    """
    chosen = plan(prepared)
    key = _key(prepared, chosen)
    results = _read(cache, key)
    if results is None:
        results = _detect(prepared, chosen, progress)
        write_bytes(cache, bytes(msgpack.packb([key, [pack(result) for result in results]])))
    return sorted(_with_poses(prepared, results), key=lambda result: result.order)


def _detect(prepared: PreparedMission, chosen: Plan, progress: Progress) -> list[Detections]:
    results: list[Detections] = []

    def keep(message: Message) -> None:
        if isinstance(message, Detections):
            results.append(message)

    process(prepared, chosen, keep, progress)
    return results


def _with_poses(prepared: PreparedMission, results: list[Detections]) -> list[Detections]:
    streams = {s.stream: s for s in prepared.streams}
    placed = []
    for result in results:
        s = streams[result.stream]
        pose = s.trajectory.pose((result.time_ns - s.start_ns) * 1e-9)
        if pose is None:
            continue
        placed.append(replace(result, pose=pose))
    return placed


def _key(prepared: PreparedMission, chosen: Plan) -> str:
    """Of all that the boxes depend on, the code included."""
    links = sorted(prepared.problem.link_bps.items())
    digest = hashlib.sha256(repr((chosen.assignments, links, prepared.mission.processing)).encode())
    digest.update(code_sha256(*_CODE).encode())
    for s in prepared.streams:
        for path in s.source.paths:
            digest.update(path.read_bytes())
    for detector in sorted({a.pool_detector for a in chosen.assignments}):
        used = prepared.runnable(detector)
        digest.update(used.require_model(detector).read_bytes())
        digest.update(repr((used.score_threshold, used.calibration)).encode())
    return digest.hexdigest()


def _read(cache: Path, key: str) -> list[Detections] | None:
    """What the file holds, or None if there is none of this key: a spoiled one is made again."""
    try:
        found, packed = msgpack.unpackb(cache.read_bytes())
        messages = [unpack(data) for data in packed] if found == key else None
    except (OSError, ValueError, TypeError, ProtocolError, msgpack.UnpackException):
        return None
    if messages is None:
        return None
    return [message for message in messages if isinstance(message, Detections)]

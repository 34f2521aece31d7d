"""What a run will keep on the disk until it ends, known before it begins."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.allocation.plan import Plan
from pipeline.errors import InputError
from pipeline.fusion.voxel_map import VOXEL
from pipeline.messages import CameraPose, Detections, pack
from pipeline.mission.durable_reducer import JournalParams
from pipeline.mission.prepared import PreparedMission
from pipeline.storage.journal_segment import OVERHEAD_BYTES


@dataclass(frozen=True)
class ForecastParams:
    """boxes: of a picture, as many as a detector finds in a busy one; most find none. left_bytes: what a disk must have
    left beside, for the outputs. live_s: of a live stream, whose end nobody knows.
    """

    boxes: int = 8
    live_s: float = 3600.0
    left_bytes: int = 64 * 1024 * 1024


@dataclass(frozen=True)
class DiskForecast:
    """At most so many bytes: of the journal, and of all checkpoints that are there at once."""

    journal_bytes: int
    checkpoint_bytes: int
    left_bytes: int

    @property
    def bytes(self) -> int:
        """Both."""
        return self.journal_bytes + self.checkpoint_bytes

    @property
    def sentence(self) -> str:
        """For the terminal."""
        return (
            f"disk: the journal will need at most {_size(self.journal_bytes)}, "
            f"checkpoints {_size(self.checkpoint_bytes)}"
        )


def disk_forecast(
    prepared: PreparedMission, plan: Plan, journal: JournalParams, params: ForecastParams | None = None
) -> DiskForecast:
    """Rate times duration, in records of a picture with ``boxes`` boxes; of the map every cell, not compressed.

    The whole journal is counted, as if no checkpoint ever made a part of it superfluous.
    """
    params = params or ForecastParams()
    seconds = {s.stream: params.live_s if s.is_live else s.end_s - s.video.start_s for s in prepared.streams}
    rate_hz = prepared.mission.processing.frame_rate
    results = sum(seconds[a.stream] * rate_hz / a.period for a in plan.assignments)
    names = max((len(a.stream) + len(a.detector) for a in plan.assignments), default=0)
    record = len(pack(_specimen("s" * names, params.boxes))) + OVERHEAD_BYTES
    cells = int(np.prod(prepared.terrain.shape)) * len(prepared.mission.fusion.classes)
    # what a checkpoint keeps of each result beside the map: its frame in three accounts, and its boxes' places
    state = cells * VOXEL.itemsize + results * (3 * 9 + params.boxes * _LOOK_BYTES)
    # one more than are kept: the next is written before the oldest goes
    return DiskForecast(round(results * record), round(state * (journal.checkpoints + 1)), params.left_bytes)


def require_room(forecast: DiskForecast, out: Path) -> None:
    """Raises InputError if the disk of a run directory has less than the run will need."""
    folder = next(p for p in (out.absolute(), *out.absolute().parents) if p.exists())
    free = shutil.disk_usage(folder).free
    need = forecast.bytes + forecast.left_bytes
    if free < need:
        found = f"{_size(free)} free on its disk"
        expected = (
            f"{_size(need)}: {_size(forecast.journal_bytes)} for the journal of this run, "
            f"{_size(forecast.checkpoint_bytes)} for its checkpoints, the rest for what it finds"
        )
        raise InputError(out, found, expected)


#: of a sighting in a checkpoint: its numbers, 9 bytes each, and its names
_LOOK_BYTES = 36 * 9 + 120


def _specimen(name: str, boxes: int) -> Detections:
    pose = CameraPose(np.zeros(3), np.eye(3))
    found = np.zeros((boxes, 4)), np.zeros(boxes), np.zeros(boxes, dtype=np.int64)
    return Detections(name, "", 1 << 30, 1 << 60, pose, *found)


def _size(count: float) -> str:
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 1000.0 or unit == "GB":
            return f"{count:.0f} {unit}" if unit == "bytes" else f"{count:.1f} {unit}"
        count /= 1000.0
    raise AssertionError

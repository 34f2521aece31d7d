"""A mission of live streams once it is over: as one of recordings, as long as they were."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.ingest.live.live_trajectory import WAY_COLUMNS, LiveTrajectory
from pipeline.ingest.live.source import LiveSource
from pipeline.messages import FloatArray
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.stages.source import StreamInput


@dataclass(frozen=True)
class Flown:
    """ways: by stream, (N, WAY_COLUMNS), as they were flown. reached_s: time of the last picture of each stream."""

    ways: Mapping[str, FloatArray] = field(default_factory=dict)
    reached_s: Mapping[str, float] = field(default_factory=dict)


def as_flown(prepared: PreparedMission, flown: Flown) -> PreparedMission:
    """One of recordings is left as it is."""
    if not prepared.mission.is_live:
        return prepared
    nothing = np.zeros((0, WAY_COLUMNS))
    streams = tuple(
        _flown(s, flown.ways.get(s.stream, nothing), flown.reached_s.get(s.stream, 0.0))
        for s in prepared.streams
    )
    return replace(prepared, streams=streams)


def _flown(stream: StreamInput, rows: FloatArray, reached_s: float) -> StreamInput:
    source, way = stream.source, stream.trajectory
    assert isinstance(source, LiveSource)
    assert isinstance(way, LiveTrajectory)
    last_s = max(reached_s, 0.0) + 1.0 / source.info.frame_rate
    return replace(stream, source=source.flown(last_s), trajectory=way.flown(rows))

"""A mission's telemetry, written again with the errors that the paper's real flight had.

The videos stay, and with them the true poses: only what the drone tells of itself is wrong.
"""

from __future__ import annotations

import math
import os
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pipeline.config.mission import Stream
from pipeline.config.scenario import PoseNoise
from pipeline.config.uncertainty import Uncertainty
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.track import Track
from pipeline.mission.prepared import prepare
from pipeline.simulation.flight import Flight
from pipeline.simulation.pose_noise import disturbed
from pipeline.simulation.srt_writer import dji_srt
from pipeline.storage.whole_or_nothing import write_text

#: what does not change during a flight, or hardly: satellite positioning, compass and gimbal, the clocks
_SLOW = PoseNoise.model_validate(
    {
        "position": {"meters": 0.5},
        "attitude": {"degrees": 1.0},
        "correlation_time": {"seconds": 300},
        "time_offset": {"milliseconds": 100},
    }
)
#: what does
_FAST = PoseNoise.model_validate(
    {
        "position": {"meters": 0.05},
        "attitude": {"degrees": 0.2},
        "correlation_time": {"seconds": 1},
        "time_offset": {"seconds": 0},
    }
)
#: the same in words, for the report
PAPERS_FLIGHT = {
    "position": "0.5 m (one deviation) on each axis, constant to 300 s: the paper's drone without RTK "
    "is specified to hover within 1.5 m of where it should, taken as three standard deviations; with it the "
    "paper's own way of placing comes near the paper's figures (the second group of figures)",
    "attitude": "1.0 degree in each of yaw, pitch and roll, constant to 300 s: a calibrated compass, and a "
    "gimbal without a common zero with the camera",
    "clock": "100 ms: video and telemetry without hardware synchronisation; telemetry comes at 10 Hz",
    "wandering": "0.05 m and 0.2 degrees, correlated over 1 s: position filter and gimbal",
    "seeds": "each flight draws its own errors for each drone; figures are means over all of them",
}
#: what such a mission knows of itself, for its error ellipses: the clock moves a drone of 3 m/s by 0.3 m
STATED = Uncertainty().model_copy(
    update={
        "position_bias": math.hypot(0.5, 0.3 / math.sqrt(2.0)),
        "height_bias": 0.5,
        "attitude_bias": math.radians(1.0),
        "position_noise": 0.05,
        "attitude_noise": math.radians(0.2),
        "correlation_time": 1.0,
        "terrain": 0.1,
    }
)
_NOISE_STREAM = 6


def mission_with_pose_errors(mission: Path, folder: Path, number: int) -> Path:
    """A mission file in the folder with the videos of the given one, telemetry of its own, and its errors as stated.

    number: of the flight; the same number gives the same files.
    """
    prepared = prepare(mission)
    folder.mkdir(parents=True, exist_ok=True)
    document = yaml.safe_load(mission.read_text(encoding="utf-8"))
    for k, (stream, entry) in enumerate(zip(prepared.mission.streams, document["streams"], strict=True)):
        rng = np.random.default_rng([_NOISE_STREAM, number, k])
        write_text(folder / f"{stream.id}.srt", _disturbed_srt(stream, prepared.frame, rng))
        entry["telemetry"]["file"] = f"{stream.id}.srt"
        for key in ("video", "camera"):
            entry[key] = _from(folder, mission.parent / entry[key])
    for key in ("inventory", "pool", "truth"):
        document[key] = _from(folder, mission.parent / document[key])
    document["terrain"]["file"] = _from(folder, mission.parent / document["terrain"]["file"])
    document.setdefault("fusion", {})["uncertainty"] = _stated()
    write_text(folder / "mission.yaml", _yaml(document))
    return folder / "mission.yaml"


def _stated() -> dict[str, dict[str, float]]:
    """STATED as a mission file says it. Poses carry what the file says, so to say it later would be too late."""
    metres = ("position_bias", "height_bias", "position_noise", "terrain", "body", "widest_look")
    said = {key: {"meters": float(getattr(STATED, key))} for key in metres}
    said |= {
        key: {"degrees": math.degrees(getattr(STATED, key))} for key in ("attitude_bias", "attitude_noise")
    }
    said |= {key: {"seconds": float(getattr(STATED, key))} for key in ("correlation_time", "cause_time")}
    return said | {"box": {"pixels": float(STATED.box)}}


def _disturbed_srt(stream: Stream, frame: LocalFrame, rng: np.random.Generator) -> str:
    track = read_telemetry(stream.telemetry)
    told = disturbed(disturbed(_flight(track, frame), _SLOW, rng), _FAST, rng)
    start = datetime.fromtimestamp(0, UTC) + timedelta(microseconds=track.start_time_ns // 1000)
    takeoff_m = float(track.absolute_height_m[0] - track.relative_height_m[0])
    return dji_srt(told, frame, start, takeoff_m)


def _flight(track: Track, frame: LocalFrame) -> Flight:
    east, north = frame.enu_from_wgs84(track.latitude_deg, track.longitude_deg)
    angles = np.stack([np.unwrap(track.yaw_rad), track.pitch_rad, track.roll_rad], axis=1)
    return Flight(track.times_s, np.stack([east, north, track.absolute_height_m], axis=1), angles)


def _from(folder: Path, path: Path) -> str:
    return os.path.relpath(path.resolve(), folder.resolve())


def _yaml(document: dict[str, Any]) -> str:
    return str(yaml.safe_dump(document, sort_keys=False))

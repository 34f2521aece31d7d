"""Where each camera was and what it could see: what is kept of a flight for whoever looks at the run."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.geo.camera import Camera
from pipeline.messages import CameraPose, FloatArray


@dataclass(frozen=True, eq=False)
class Flight:
    """One stream. videos: path and the time of the stream at which it begins, seconds; stills have none. start_ns: of
    the stream's time 0, ns UTC. times_s: (N,), increasing. positions: (N, 3), metres. rotations: (N, 3, 3),
    enu_from_camera. focal: (N,), as in ``CameraPose.focal_scale``.
    """

    stream: str
    site: str
    camera: Camera
    start_ns: int
    videos: tuple[tuple[str, float], ...]
    times_s: FloatArray
    positions: FloatArray
    rotations: FloatArray
    focal: FloatArray

    def pose(self, number: int) -> CameraPose:
        """One of N."""
        return CameraPose(
            self.positions[number].astype(np.float64),
            self.rotations[number].astype(np.float64),
            focal_scale=float(self.focal[number]),
        )

    def video_at(self, time_s: float) -> tuple[int, float] | None:
        """Number of the video file and the time in it of a moment of the stream; None without a video."""
        begun = [(k, offset) for k, (_, offset) in enumerate(self.videos) if offset <= time_s + 1e-6]
        return (begun[-1][0], time_s - begun[-1][1]) if begun else None


_CAMERA = ("width", "height", "fx", "fy", "cx", "cy")


def encoded(flights: Sequence[Flight]) -> bytes:
    """As a file: 56 bytes a pose before compression."""
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {"head": np.array(json.dumps([_head(flight) for flight in flights]))}
    for k, flight in enumerate(flights):
        arrays[f"times{k}"] = flight.times_s.astype(np.float64)
        arrays[f"positions{k}"] = flight.positions.astype(np.float32)
        arrays[f"rotations{k}"] = flight.rotations.astype(np.float32)
        arrays[f"focal{k}"] = flight.focal.astype(np.float32)
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def decoded(data: bytes) -> tuple[Flight, ...]:
    """Of a file."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        heads = json.loads(str(file["head"]))
        return tuple(
            Flight(
                head["stream"],
                head["site"],
                _camera(head["camera"]),
                head["start_ns"],
                tuple((path, offset) for path, offset in head["videos"]),
                *(file[f"{name}{k}"] for name in ("times", "positions", "rotations", "focal")),
            )
            for k, head in enumerate(heads)
        )


def _camera(head: dict[str, Any]) -> Camera:
    width, height, fx, fy, cx, cy = (head[name] for name in _CAMERA)
    return Camera(width, height, fx, fy, cx, cy, np.array(head["distortion"], dtype=np.float64))


def _head(flight: Flight) -> dict[str, Any]:
    camera = {name: getattr(flight.camera, name) for name in _CAMERA}
    return {
        "stream": flight.stream,
        "site": flight.site,
        "camera": camera | {"distortion": flight.camera.distortion.tolist()},
        "start_ns": flight.start_ns,
        "videos": [list(video) for video in flight.videos],
    }

"""The frozen records that travel between the stages, and their wire form (msgpack).

Frames of reference
-------------------
``enu``: the mission's local map frame, x east, y north, z up, metres (see ``pipeline.geo.frame``).
``camera``: x right, y down, z along the optical axis (the OpenCV convention).
Pixels: x right, y down, (0, 0) is the *corner* of the first pixel; its centre is (0.5, 0.5).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import msgpack
import numpy as np
from av.video.frame import VideoFrame
from numpy.typing import NDArray

from pipeline.errors import ProtocolError

FloatArray = NDArray[np.float64]
MAX_MESSAGE_BYTES = 16 * 1024 * 1024


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """Where the camera is and where it looks.

    position_enu: float64 (3,), metres. enu_from_camera: float64 (3, 3), a rotation. horizontal_sd_m (each
    axis), height_sd_m, attitude_sd_rad (each angle): standard deviations that the telemetry states for this
    moment; NaN where it states none. focal_scale: focal length now over that of the stream's camera, > 0.
    """

    position_enu: FloatArray
    enu_from_camera: FloatArray
    horizontal_sd_m: float = math.nan
    height_sd_m: float = math.nan
    attitude_sd_rad: float = math.nan
    focal_scale: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One picture of one stream. Never travels between processes.

    planes: FFmpeg's frame, yuv420p, upright, at the size that is sent. time_ns: capture time, ns UTC; time_s: of
    the video. index: number of the frame in its video, from 0; tick: number on the processing clock.
    """

    stream: str
    index: int
    tick: int
    time_s: float
    time_ns: int
    pose: CameraPose
    planes: VideoFrame


@dataclass(frozen=True, slots=True, eq=False)
class Packet:
    """One encoded frame of one substream.

    data: the codec's bytes. pts: presentation time in units of time_base_num / time_base_den seconds.
    width, height: pixels of the stream's picture, which the encoded one may be smaller than; 0: as encoded.
    encode_s: what encoding took. link_s: how long the link needed, where the sender can know it (pace max);
    otherwise the receiver takes the difference to sent_ns, the sender's clock, ns UTC. epoch: of the plan that
    it was sent under. sequence: number of the message within its substream and epoch, from 0, without gaps.
    """

    stream: str
    detector: str
    index: int
    time_ns: int
    pts: int
    time_base_num: int
    time_base_den: int
    keyframe: bool
    pose: CameraPose
    data: bytes
    encode_s: float = 0.0
    link_s: float = 0.0
    sent_ns: int = 0
    width: int = 0
    height: int = 0
    epoch: int = 0
    sequence: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Hops:
    """Seconds that one result spent on each part of its way. They never influence the map."""

    encode_s: float = 0.0
    transfer_s: float = 0.0
    decode_s: float = 0.0
    detect_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """What one detector saw in one frame; N = 0 is evidence too.

    boxes_px: float64 (N, 4) x0, y0, x1, y1 in pixels of the stream's own picture, at whatever size it was sent.
    scores: float64 (N,) in 0..1. class_ids: int64 (N,). epoch, sequence: of the packet.
    """

    stream: str
    detector: str
    index: int
    time_ns: int
    pose: CameraPose
    boxes_px: FloatArray
    scores: FloatArray
    class_ids: NDArray[np.int64]
    hops: Hops = Hops()
    epoch: int = 0
    sequence: int = 0

    @property
    def order(self) -> tuple[int, str, str]:
        """Results are applied to the map in this order; it is also what makes two results the same."""
        return self.time_ns, self.stream, self.detector


@dataclass(frozen=True, slots=True)
class Dropped:
    """A frame of a substream that will not be processed, and why. epoch, sequence: of its packet."""

    stream: str
    detector: str
    index: int
    time_ns: int
    reason: str
    epoch: int = 0
    sequence: int = 0


@dataclass(frozen=True, slots=True)
class EndOfStream:
    """The last message of a substream (stream, detector). sequence: how many packets came before it."""

    stream: str
    detector: str
    epoch: int = 0
    sequence: int = 0


Message = Packet | Detections | Dropped | EndOfStream
_RECORDS: dict[str, type] = {
    cls.__name__: cls for cls in (CameraPose, Packet, Hops, Detections, Dropped, EndOfStream)
}
_DTYPES = {"float64": np.float64, "int64": np.int64}
#: what may stand in a field of this annotation
_TYPES: dict[str, tuple[type, ...]] = {
    "str": (str,),
    "int": (int,),
    "float": (float, int),
    "bool": (bool,),
    "bytes": (bytes,),
    "CameraPose": (CameraPose,),
    "Hops": (Hops,),
    "FloatArray": (np.ndarray,),
    "NDArray[np.int64]": (np.ndarray,),
}
#: dtype and shape of the array fields; -1 is the number of detections, the same in all of them
_ARRAYS = {
    "position_enu": (np.float64, (3,)),
    "enu_from_camera": (np.float64, (3, 3)),
    "boxes_px": (np.float64, (-1, 4)),
    "scores": (np.float64, (-1,)),
    "class_ids": (np.int64, (-1,)),
}


def pack(message: Message) -> bytes:
    """The wire form of a message: msgpack of its fields, arrays as raw little-endian bytes."""
    return bytes(msgpack.packb(message, default=_encode, use_bin_type=True))


def unpack(data: bytes | bytearray | memoryview) -> Message:
    """The message in the wire form. Raises ProtocolError if it is not one of ours."""
    if len(data) > MAX_MESSAGE_BYTES:
        raise ProtocolError(f"a message of {len(data)} bytes; at most {MAX_MESSAGE_BYTES} are taken")
    try:
        message = msgpack.unpackb(data, object_hook=_decode)
    except ProtocolError:
        raise
    except Exception as error:
        raise ProtocolError(f"not a message: {error}") from error
    if not isinstance(message, Packet | Detections | Dropped | EndOfStream):
        raise ProtocolError(f"not a message: {type(message).__name__}")
    return message


def _encode(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        if value.dtype.name not in _DTYPES:
            raise TypeError(f"an array of {value.dtype.name} does not travel")
        return {"@": "array", "dtype": value.dtype.name, "shape": value.shape, "data": value.tobytes()}
    if type(value).__name__ in _RECORDS:
        return {"@": type(value).__name__} | {f.name: getattr(value, f.name) for f in fields(value)}
    raise TypeError(f"{type(value).__name__} does not travel")


def _decode(value: dict[str, Any]) -> Any:
    kind = value.pop("@", None)
    if kind == "array":
        dtype = _DTYPES.get(value["dtype"])
        if dtype is None:
            raise ProtocolError(f"array of {value['dtype']!r}")
        return np.frombuffer(value["data"], dtype=dtype).reshape(value["shape"])
    if kind in _RECORDS:
        return _record(_RECORDS[kind], value)
    raise ProtocolError(f"record of kind {kind!r}")


def _record(cls: type, values: dict[str, Any]) -> Any:
    """The record, if every field is what its annotation says: what comes from a wire is not believed."""
    count = len(values["scores"]) if cls is Detections else 0
    for field in fields(cls):
        value = values.get(field.name, field.default)
        if type(value) not in _TYPES[str(field.type)]:
            raise ProtocolError(f"{cls.__name__}.{field.name} is of type {type(value).__name__}")
        if field.name in _ARRAYS:
            dtype, shape = _ARRAYS[field.name]
            wanted = tuple(count if size == -1 else size for size in shape)
            if value.dtype != dtype or value.shape != wanted:
                raise ProtocolError(
                    f"{cls.__name__}.{field.name} is {value.dtype} {value.shape}, not {wanted}"
                )
    return cls(**values)

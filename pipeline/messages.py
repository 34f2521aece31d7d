"""The frozen records that travel between the stages, and their wire form (msgpack).

Frames of reference
-------------------
``enu``: the mission's local map frame, x east, y north, z up, metres (see ``pipeline.geo.frame``).
``camera``: x right, y down, z along the optical axis (the OpenCV convention).
Pixels: x right, y down, (0, 0) is the *corner* of the first pixel; its centre is (0.5, 0.5).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import Field, dataclass, fields
from functools import partial
from operator import attrgetter
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
    encode_s: what encoding took. source_s: what else it cost from when the frame was due until it was given to the
    link. link_s: how long the link needed, where the sender can know it (pace max);
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
    source_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Hops:
    """Seconds that one result spent on each part of its way. They never influence the map.

    source_s: from when the frame was due until it was given to the link, encoding left out. wait_s: at the machine,
    until it was decoded. answered_ns: when the machine had its result, ns UTC; 0 where nobody asked.
    """

    encode_s: float = 0.0
    transfer_s: float = 0.0
    decode_s: float = 0.0
    detect_s: float = 0.0
    source_s: float = 0.0
    wait_s: float = 0.0
    answered_ns: int = 0


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
#: of the wire form; both ends of a connection must speak the same. Raised when a field comes, goes or moves, and
#: when the way to seal it changes
WIRE_VERSION = 4
#: the number of a message on the wire is its place here
_MESSAGES: tuple[type[Message], ...] = (Packet, Detections, Dropped, EndOfStream)
_NUMBERS = {cls: number for number, cls in enumerate(_MESSAGES)}
_RECORDS: dict[str, type] = {"CameraPose": CameraPose, "Hops": Hops}
#: a message holds no longer array than its number and its fields, and no more arrays than itself and its records
_MOST_VALUES = 1 + max(len(fields(cls)) for cls in _MESSAGES)
_MOST_ARRAYS = 1 + len(_RECORDS)
#: what may stand in a field of this annotation
_TYPES: dict[str, tuple[type, ...]] = {
    "str": (str,),
    "int": (int,),
    "float": (float, int),
    "bool": (bool,),
    "bytes": (bytes,),
}
#: names and reasons are no longer than so many characters
_LONGEST_TEXT = 255
_INT64 = 2**63 - 1
#: the least and the most of a number in a field of this name; what is beyond would break what stores or counts it
_RANGES: dict[str, tuple[float, float]] = {
    "index": (0, 2**48),
    "sequence": (0, 2**48),
    "epoch": (0, 2**31),
    "time_ns": (0, _INT64),
    "sent_ns": (0, _INT64),
    "pts": (-_INT64, _INT64),
    "time_base_num": (1, 2**31),
    "time_base_den": (1, 2**31),
    "width": (0, 2**16),
    "height": (0, 2**16),
    "encode_s": (0.0, 1e9),
    "link_s": (0.0, 1e9),
    "transfer_s": (0.0, 1e9),
    "decode_s": (0.0, 1e9),
    "detect_s": (0.0, 1e9),
    "source_s": (0.0, 1e9),
    "wait_s": (0.0, 1e9),
    "answered_ns": (0, _INT64),
    "horizontal_sd_m": (0.0, math.inf),
    "height_sd_m": (0.0, math.inf),
    "attitude_sd_rad": (0.0, math.inf),
    "focal_scale": (1e-9, 1e9),
}
#: of these NaN says that there is none
_MAY_BE_NAN = frozenset({"horizontal_sd_m", "height_sd_m", "attitude_sd_rad"})
#: dtype and shape of the array fields; -1 is the number of detections, the same in all of them
_ARRAYS: dict[str, tuple[type, tuple[int, ...]]] = {
    "position_enu": (np.float64, (3,)),
    "enu_from_camera": (np.float64, (3, 3)),
    "boxes_px": (np.float64, (-1, 4)),
    "scores": (np.float64, (-1,)),
    "class_ids": (np.int64, (-1,)),
}


def pack(message: Message) -> bytes:
    """The wire form of a message: its number, then its fields in their order, as a msgpack array.

    A record in a field is an array of its fields; an array is its bytes, little-endian, whose dtype and shape
    the field decides. Raises TypeError for what does not travel.
    """
    number = _NUMBERS.get(type(message))
    if number is None:
        raise TypeError(f"{type(message).__name__} does not travel")
    if type(message) is Detections and not (
        len(message.boxes_px) == len(message.scores) == len(message.class_ids)
    ):
        raise TypeError("an array that does not travel as boxes, scores and classes are of different number")
    return bytes(msgpack.packb([number, *_values(message)], use_bin_type=True))


def unpack(data: bytes | bytearray | memoryview) -> Message:
    """The message in the wire form. Raises ProtocolError if it is not one of ours."""
    if len(data) > MAX_MESSAGE_BYTES:
        raise ProtocolError(f"a message of {len(data)} bytes; at most {MAX_MESSAGE_BYTES} are taken")
    try:
        count = _Containers()
        values = msgpack.unpackb(
            data,
            list_hook=count,
            object_hook=count,
            max_array_len=_MOST_VALUES,
            max_map_len=_MOST_VALUES,
            max_ext_len=0,
        )
        if type(values) is not list or not values or type(values[0]) is not int:
            raise ProtocolError(f"not a message: {type(values).__name__}")
        if not 0 <= values[0] < len(_MESSAGES):
            raise ProtocolError(f"not a message: number {values[0]}")
        message: Message = _record(_MESSAGES[values[0]], values[1:])
    except ProtocolError:
        raise
    except Exception as error:
        raise ProtocolError(f"not a message: {error}") from error
    return message


class _Containers:
    """Counts the arrays and maps of one message while they are read: the message, and the records in its fields.

    With the length of each bounded too, what is no message cannot make us build millions of values first.
    """

    def __init__(self) -> None:
        self._count = 0

    def __call__(self, values: Any) -> Any:
        self._count += 1
        if self._count > _MOST_ARRAYS:
            raise ProtocolError(f"not a message: more than {_MOST_ARRAYS} arrays or maps")
        return values


def _values(record: Any) -> list[Any]:
    """A record's fields as msgpack has them. What is no record is passed on as it is: the far end refuses it."""
    if type(record) not in _PLAIN:
        return record
    fields_of, special = _PLAIN[type(record)]
    values = list(fields_of(record))
    for place, plain in special:
        values[place] = plain(values[place])
    return values


def _plain_of(cls: type) -> tuple[Callable[[Any], Any], tuple[tuple[int, Callable[[Any], Any]], ...]]:
    """What gives all fields of a record, and the places of those that are not plain yet, with what makes them so."""
    special: list[tuple[int, Callable[[Any], Any]]] = []
    for place, field in enumerate(fields(cls)):
        if str(field.type) in _RECORDS:
            special.append((place, _values))
        elif field.name in _ARRAYS:
            dtype, shape = _ARRAYS[field.name]
            special.append((place, partial(_array_bytes, field.name, np.dtype(dtype), shape)))
    return attrgetter(*(field.name for field in fields(cls))), tuple(special)


def _array_bytes(name: str, dtype: np.dtype[Any], shape: tuple[int, ...], value: NDArray[Any]) -> bytes:
    right = value.ndim == len(shape) and value.shape[1:] == shape[1:] and shape[0] in (-1, value.shape[0])
    if value.dtype != dtype or not right:
        found = f"{value.dtype.name} {value.shape}"
        raise TypeError(f"an array of {found} does not travel as {name}: {dtype.name} {shape}")
    return value.tobytes()


def _record(cls: type, values: Any) -> Any:
    """The record, if every field is what its annotation says: what comes from a wire is not believed.

    First all fields at once, since this is done for every message; field by field only to say which one it is.
    """
    form = _FORMS[cls]
    if type(values) is not list or len(values) != len(form.types):
        found = f"{len(values)} fields" if type(values) is list else type(values).__name__
        raise ProtocolError(f"{cls.__name__} is {found}, not {len(form.types)} fields")
    if tuple(map(type, values)) != form.types:
        values = [check(value) for check, value in zip(form.checks, values, strict=True)]
    else:
        for place, least, most in form.ranges:
            if not least <= values[place] <= most:
                form.checks[place](values[place])
        for place in form.special:
            values[place] = form.checks[place](values[place])
    record = cls(*values)
    if cls is Detections and not len(record.boxes_px) == len(record.scores) == len(record.class_ids):
        raise ProtocolError("Detections with boxes, scores and classes of different number")
    return record


@dataclass(frozen=True)
class _Form:
    """What the fields of a record are on the wire: their types, the places and limits of numbers, the places of those
    that are more than that, and a check of each.
    """

    types: tuple[type, ...]
    ranges: tuple[tuple[int, float, float], ...]
    special: tuple[int, ...]
    checks: tuple[Callable[[Any], Any], ...]


def _form_of(cls: type) -> _Form:
    types: list[type] = []
    ranges, special = [], []
    for place, field in enumerate(fields(cls)):
        annotation = str(field.type)
        is_record, is_array = annotation in _RECORDS, field.name in _ARRAYS
        types.append(list if is_record else bytes if is_array else _TYPES[annotation][0])
        if is_record or is_array or annotation == "str":
            special.append(place)
        elif field.name in _RANGES:
            ranges.append((place, *_RANGES[field.name]))
    checks = tuple(_check_of(cls, field) for field in fields(cls))
    return _Form(tuple(types), tuple(ranges), tuple(special), checks)


def _check_of(cls: type, field: Field[Any]) -> Callable[[Any], Any]:
    """What makes of a value on the wire that of a field, or raises ProtocolError."""
    where, annotation = f"{cls.__name__}.{field.name}", str(field.type)
    if annotation in _RECORDS:
        return partial(_record, _RECORDS[annotation])
    if field.name in _ARRAYS:
        return partial(_array, where, *_ARRAYS[field.name])
    types = _TYPES[annotation]
    if annotation == "str":
        return partial(_text, where)
    if field.name in _RANGES:
        return partial(_number, where, types, *_RANGES[field.name], field.name in _MAY_BE_NAN)

    def of_type(value: Any) -> Any:
        if type(value) not in types:
            raise ProtocolError(f"{where} is of type {type(value).__name__}")
        return value

    return of_type


def _number(where: str, types: tuple[type, ...], least: float, most: float, nan: bool, value: Any) -> Any:
    if type(value) not in types:
        raise ProtocolError(f"{where} is of type {type(value).__name__}")
    if least <= value <= most or (nan and math.isnan(value)):
        return value
    raise ProtocolError(f"{where} is {value}; expected {least:g}..{most:g}", "out_of_range")


def _text(where: str, value: Any) -> str:
    if type(value) is not str:
        raise ProtocolError(f"{where} is of type {type(value).__name__}")
    if len(value) > _LONGEST_TEXT:
        raise ProtocolError(f"{where} has {len(value)} characters; at most {_LONGEST_TEXT}", "out_of_range")
    return value


def _array(where: str, dtype: type, shape: tuple[int, ...], value: Any) -> NDArray[Any]:
    if type(value) is not bytes or len(value) % (8 * abs(math.prod(shape))):
        found = f"{len(value)} bytes" if type(value) is bytes else type(value).__name__
        raise ProtocolError(f"{where} is {found}, not {dtype.__name__} {shape}")
    if shape[0] != -1 and len(value) != 8 * math.prod(shape):
        raise ProtocolError(f"{where} is {len(value)} bytes, not {dtype.__name__} {shape}")
    return np.frombuffer(value, dtype=dtype).reshape(shape)


_PLAIN = {cls: _plain_of(cls) for cls in (*_MESSAGES, *_RECORDS.values())}
_FORMS = {cls: _form_of(cls) for cls in (*_MESSAGES, *_RECORDS.values())}

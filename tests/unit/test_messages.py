import dataclasses

import msgpack
import numpy as np
import pytest
from av.video.frame import VideoFrame

from pipeline.errors import ProtocolError
from pipeline.messages import (
    MAX_MESSAGE_BYTES,
    CameraPose,
    Detections,
    Dropped,
    EndOfStream,
    Frame,
    Hops,
    Packet,
    pack,
    unpack,
)

POSE = CameraPose(np.array([1.0, 2.0, 3.0]), np.eye(3))


def detections(count: int = 2) -> Detections:
    return Detections(
        "drone-1",
        "m:nano",
        7,
        1_700_000_000_000_000_007,
        POSE,
        np.arange(4.0 * count).reshape(count, 4),
        np.full(count, 0.5),
        np.zeros(count, np.int64),
        Hops(0.1, 0.2, 0.3, 0.4),
    )


def packet() -> Packet:
    return Packet("drone-1", "m:nano", 7, 70, 3, 1, 30, True, POSE, b"\x00\x01", 0.25, 0.5, 99)


def wire(record: dict[str, object]) -> bytes:
    return bytes(msgpack.packb(record))


@pytest.mark.parametrize("count", [0, 1, 5])
def test_detections_survive_the_wire(count: int) -> None:
    sent = detections(count)
    got = unpack(pack(sent))
    assert isinstance(got, Detections)
    assert got.order == sent.order
    assert dataclasses.astuple(got.hops) == dataclasses.astuple(sent.hops)
    assert got.boxes_px.shape == (count, 4)
    np.testing.assert_array_equal(got.boxes_px, sent.boxes_px)
    np.testing.assert_array_equal(got.pose.enu_from_camera, POSE.enu_from_camera)


def test_a_packet_survives_the_wire() -> None:
    got = unpack(pack(packet()))
    assert isinstance(got, Packet)
    assert (got.data, got.keyframe, got.sent_ns, got.link_s) == (b"\x00\x01", True, 99, 0.5)


@pytest.mark.parametrize("message", [Dropped("s", "d", 1, 2, "link_full"), EndOfStream("s", "d")])
def test_small_messages_survive_the_wire(message: Dropped | EndOfStream) -> None:
    assert unpack(pack(message)) == message


def test_a_frame_does_not_travel() -> None:
    frame = Frame("s", 0, 0, 0.0, 0, POSE, VideoFrame(2, 2, "yuv420p"))
    with pytest.raises(TypeError, match="does not travel"):
        pack(frame)  # type: ignore[arg-type]


def test_an_array_of_another_dtype_does_not_travel() -> None:
    with pytest.raises(TypeError, match="float32 does not travel"):
        pack(dataclasses.replace(detections(), scores=np.zeros(2, np.float32)))


def test_a_message_beyond_the_limit_is_refused() -> None:
    with pytest.raises(ProtocolError, match="at most"):
        unpack(bytes(MAX_MESSAGE_BYTES + 1))


@pytest.mark.parametrize(
    "change",
    [
        {"scores": np.zeros(3)},
        {"boxes_px": np.zeros((2, 3))},
        {"class_ids": np.zeros(2)},
        {"index": "7"},
        {"stream": 1},
        {"pose": None},
        {"pose": CameraPose(np.zeros(2), np.eye(3))},
    ],
)
def test_a_record_with_a_wrong_field_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(ProtocolError):
        unpack(pack(dataclasses.replace(detections(), **change)))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xc1",
        wire({"@": "EndOfStream", "stream": "s"}),
        wire({"@": "EndOfStream", "stream": "s", "detector": "d", "more": 1}),
        wire({"@": "Frame"}),
        wire({"@": ["EndOfStream"]}),
        wire({"stream": "s"}),
        wire({"@": "Hops"}),
        wire({"@": "array", "dtype": "object", "shape": [1], "data": b"12345678"}),
        wire({"@": "array", "dtype": "float64", "shape": [3], "data": b"12345678"}),
    ],
)
def test_bytes_that_are_no_message_are_refused(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        unpack(data)

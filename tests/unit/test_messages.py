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
        Hops(0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 7),
    )


def packet() -> Packet:
    return Packet("drone-1", "m:nano", 7, 70, 3, 1, 30, True, POSE, b"\x00\x01", 0.25, 0.5, 99)


def wire(record: object) -> bytes:
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
    with pytest.raises(TypeError, match=r"float32 .* does not travel"):
        pack(dataclasses.replace(detections(), scores=np.zeros(2, np.float32)))


def test_a_message_beyond_the_limit_is_refused() -> None:
    with pytest.raises(ProtocolError, match="at most"):
        unpack(bytes(MAX_MESSAGE_BYTES + 1))


@pytest.mark.parametrize(
    "change",
    [
        {"scores": np.zeros(3)},
        {"boxes_px": np.zeros((2, 3))},
        {"boxes_px": np.zeros((4, 2))},
        {"class_ids": np.zeros(2)},
        {"pose": CameraPose(np.zeros(2), np.eye(3))},
    ],
)
def test_an_array_that_the_field_does_not_say_does_not_travel(change: dict[str, object]) -> None:
    with pytest.raises(TypeError, match="does not travel as"):
        pack(dataclasses.replace(detections(), **change))


@pytest.mark.parametrize("change", [{"index": "7"}, {"stream": 1}, {"pose": None}, {"hops": None}])
def test_a_record_with_a_wrong_field_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(ProtocolError):
        unpack(pack(dataclasses.replace(detections(), **change)))


def changed(place: int, value: object) -> bytes:
    """Two detections on the wire, with another value at a place of the array."""
    values = msgpack.unpackb(pack(detections()))
    values[place] = value
    return wire(values)


@pytest.mark.parametrize(
    "data",
    [
        changed(0, 9),
        changed(0, -1),
        changed(0, True),
        changed(5, [b"", b""]),
        changed(5, b"12345678"),
        changed(6, bytes(63)),
        changed(6, "12345678"),
        changed(7, bytes(15)),
        changed(7, bytes(24)),
        changed(8, None),
        wire([3, "s", "d", 0]),
        wire([3, "s", "d", 0, 0, 0]),
        wire([3, "s", "d", 0, 0.5]),
        wire([]),
        wire("EndOfStream"),
    ],
)
def test_fields_too_many_too_few_or_of_another_kind_are_refused(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        unpack(data)


def test_a_message_of_the_first_wire_form_is_refused_and_not_misread() -> None:
    old = {"@": "EndOfStream", "stream": "s", "detector": "d", "epoch": 0, "sequence": 0}
    with pytest.raises(ProtocolError, match="not a message: dict"):
        unpack(wire(old))


def test_the_head_of_a_packet_is_small_beside_a_frame() -> None:
    assert len(pack(packet())) - 2 <= 230


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xc1",
        wire({"stream": "s"}),
        wire(7),
        wire(None),
    ],
)
def test_bytes_that_are_no_message_are_refused(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        unpack(data)

"""A number that no honest actor sends is refused where it comes in, before it is stored or counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.errors import ProtocolError
from pipeline.messages import CameraPose, Detections, Dropped, EndOfStream, Hops, Packet, pack, unpack

POSE = CameraPose(np.zeros(3), np.eye(3))
PACKET = Packet("v", "d", 0, 0, 0, 1, 30, True, POSE, b"x")
SEEN = Detections("v", "d", 0, 0, POSE, np.zeros((0, 4)), np.zeros(0), np.zeros(0, dtype=np.int64))
DROPPED, END = Dropped("v", "d", 0, 0, "late"), EndOfStream("v", "d")
NAN, INF = float("nan"), float("inf")

WRONG = [
    (PACKET, {"time_ns": 2**63}),
    (PACKET, {"time_ns": -1}),
    (SEEN, {"time_ns": 2**64 - 1}),
    (DROPPED, {"time_ns": 2**63}),
    (PACKET, {"index": -1}),
    (SEEN, {"index": 2**60}),
    (DROPPED, {"sequence": -1}),
    (END, {"sequence": 2**63}),
    (END, {"epoch": -1}),
    (SEEN, {"epoch": 2**40}),
    (PACKET, {"pts": 2**63}),
    (PACKET, {"time_base_den": 0}),
    (PACKET, {"time_base_num": -3}),
    (PACKET, {"width": 2**20}),
    (PACKET, {"height": -1}),
    (PACKET, {"encode_s": NAN}),
    (PACKET, {"link_s": INF}),
    (PACKET, {"sent_ns": 2**63}),
    (SEEN, {"hops": Hops(decode_s=NAN)}),
    (SEEN, {"hops": Hops(transfer_s=-1.0)}),
    (SEEN, {"hops": Hops(detect_s=INF)}),
    (SEEN, {"pose": replace(POSE, horizontal_sd_m=-1.0)}),
    (SEEN, {"pose": replace(POSE, focal_scale=0.0)}),
    (SEEN, {"pose": replace(POSE, focal_scale=NAN)}),
    (DROPPED, {"reason": "r" * 256}),
    (END, {"stream": "s" * 70_000}),
]


@pytest.mark.parametrize(("message", "field"), WRONG)
def test_a_number_or_a_name_out_of_range(message: Packet, field: dict[str, object]) -> None:
    assert type(unpack(pack(message))) is type(message)
    with pytest.raises(ProtocolError, match=r"expected|at most") as refused:
        unpack(pack(replace(message, **field)))  # type: ignore[arg-type]
    assert refused.value.reason == "out_of_range"


def test_a_standard_deviation_that_is_not_stated_is_none_of_these() -> None:
    assert np.isnan(unpack(pack(SEEN)).pose.height_sd_m)  # type: ignore[union-attr]

"""What waits for a detector is bounded; what is dropped is counted, and ends with a packet that stands alone."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.clock import Clock
from pipeline.errors import RunFailedError
from pipeline.messages import CameraPose, Dropped, EndOfStream, Packet
from pipeline.mission.stages.inbox import Inbox, InboxParams

POSE = CameraPose(np.zeros(3), np.eye(3))


def packet(index: int, keyframe: bool = False) -> Packet:
    return Packet("v", "d", index, index, index, 1, 10, keyframe, POSE, b"x", epoch=2, sequence=index)


class Seen:
    def __init__(self, packets: int = 3, drops: bool = True, **more: Any) -> None:
        self.dropped: list[Dropped] = []
        self.asked = 0
        self.now_s = 0.0
        clock = Clock(lambda: self.now_s, utc_ns=lambda: 77)
        params = InboxParams(packets=packets, **more)
        self.inbox = Inbox(params, clock, drops=drops, on_drop=self.dropped.append, want_restart=self._ask)

    def _ask(self) -> None:
        self.asked += 1

    def take(self) -> int:
        message = self.inbox.get().message
        return message.index if isinstance(message, Packet) else -1


def test_messages_come_out_as_they_went_in_with_the_time_they_came() -> None:
    seen = Seen()
    seen.now_s = 5.0
    seen.inbox.put(packet(0, True))
    seen.inbox.put(EndOfStream("v", "d"))
    first = seen.inbox.get()
    assert (first.message.index, first.received_ns, first.received_s) == (0, 77, 5.0)  # type: ignore[union-attr]
    assert isinstance(seen.inbox.get().message, EndOfStream)


def test_a_full_inbox_drops_until_there_is_room_and_a_packet_that_stands_alone() -> None:
    seen = Seen(packets=2)
    for index in range(4):
        seen.inbox.put(packet(index, keyframe=index == 0))
    assert seen.asked == 0, "nobody would take it yet"
    assert [seen.take(), seen.take()] == [0, 1]
    seen.inbox.put(packet(4))
    seen.inbox.put(packet(5))
    assert seen.asked == 1
    seen.inbox.put(packet(6, keyframe=True))
    seen.inbox.put(packet(7))
    assert [seen.take(), seen.take()] == [6, 7]
    assert [(d.index, d.reason, d.epoch, d.sequence) for d in seen.dropped] == [
        (i, "machine_busy", 2, i) for i in (2, 3, 4, 5)
    ]


def test_a_key_frame_that_finds_no_room_is_asked_for_again() -> None:
    seen = Seen(packets=1)
    seen.inbox.put(packet(0, True))
    seen.inbox.put(packet(1))
    seen.take()
    seen.inbox.put(packet(2))
    assert seen.asked == 1
    seen.inbox.put(packet(3, True))
    seen.inbox.put(packet(4, True))
    seen.take()
    seen.inbox.put(packet(5))
    assert seen.asked == 2
    assert [d.index for d in seen.dropped] == [1, 2, 4, 5]


def test_the_end_of_a_stream_is_taken_however_full_it_is() -> None:
    seen = Seen(packets=1)
    seen.inbox.put(packet(0, True))
    seen.inbox.put(EndOfStream("v", "d"))
    assert len(seen.inbox) == 2


def test_a_frame_that_waited_too_long_is_late_by_the_monotonic_clock_but_not_where_nothing_may_be_dropped() -> (
    None
):
    for drops in (True, False):
        seen = Seen(drops=drops, max_wait_s=1.0)
        seen.inbox.put(packet(0, True))
        waiting = seen.inbox.get()
        seen.now_s = 1.0
        assert not seen.inbox.is_late(waiting)
        seen.now_s = 1.1
        assert seen.inbox.is_late(waiting) is drops


def test_where_nothing_may_be_dropped_the_sender_waits_for_room() -> None:
    seen = Seen(packets=1, drops=False, patience_s=20.0)
    seen.inbox.put(packet(0))
    threading.Timer(0.05, seen.take).start()
    seen.inbox.put(packet(1))
    assert seen.take() == 1
    assert seen.dropped == []


def test_a_detector_that_hangs_is_named_after_the_time_limit() -> None:
    seen = Seen(packets=1, drops=False, patience_s=0.05)
    seen.inbox.put(packet(0))
    with pytest.raises(RunFailedError, match=r"detector d took no packet for 0\.05 s"):
        seen.inbox.put(packet(1))


@given(st.integers(1, 4), st.lists(st.tuples(st.sampled_from(["put", "key", "take"])), max_size=60))
def test_every_packet_is_taken_or_dropped_and_no_decoder_misses_one(
    packets: int, steps: list[tuple[str]]
) -> None:
    seen, index, taken = Seen(packets), 0, []
    for (step,) in steps:
        if step == "take":
            if len(seen.inbox):
                taken.append(seen.inbox.get().message)
            continue
        seen.inbox.put(packet(index, keyframe=step == "key" or index == 0))
        index += 1
        assert len(seen.inbox) <= packets
    taken += [seen.inbox.get().message for _ in range(len(seen.inbox))]
    assert sorted([m.index for m in taken] + [d.index for d in seen.dropped]) == list(range(index))  # type: ignore[union-attr]
    for before, after in zip([None, *taken], taken, strict=False):
        follows = before is not None and after.index == before.index + 1  # type: ignore[union-attr]
        assert follows or after.keyframe  # type: ignore[union-attr]


@pytest.mark.parametrize("wrong", [{"packets": 0}, {"max_wait_s": 0.0}, {"patience_s": -1.0}])
def test_limits_that_take_nothing_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="expected at least one packet"):
        InboxParams(**wrong)

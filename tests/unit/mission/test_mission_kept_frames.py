"""Frames that no link could take are kept, sent once it can, each once, and what is filmed meanwhile does not wait."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.allocation.plan import Assignment
from pipeline.link.codec import Decoder
from pipeline.messages import EndOfStream, Message, Packet
from pipeline.mission.stages.source import SourceParams, SourceStage
from tests.unit.mission.test_mission_source_stage import assignment, stream_input, video  # noqa: F401

#: as many as the video has at 30 Hz
FRAMES = 30
RATE_HZ = 30.0


class Radio:
    """Up and free, down, or full, as a list says for each moment. sent: what went over it, and when."""

    def __init__(self, states: list[str]) -> None:
        self.states, self.sent = states, list[tuple[float, Message]]()
        self.restarts: set[str] = set()

    def state(self, now_s: float) -> str:
        return self.states[min(int(now_s * RATE_HZ + 1e-6), len(self.states) - 1)]

    def is_up(self, site: str, detector: str) -> bool:
        return self.state(self.now_s) != "down"

    def backlog_s(self, site: str, now_s: float) -> float:
        self.now_s = now_s
        return 5.0 if self.state(now_s) == "full" else 0.0

    def send(self, site: str, detector: str, message: Message, now_s: float) -> bool:
        assert self.state(now_s) == "up" or isinstance(message, EndOfStream)
        self.sent.append((now_s, message))
        return True

    now_s = 0.0

    def take_restarts(self):
        restarts, self.restarts = self.restarts, set()
        return restarts

    def take_lost(self):
        return ()


def flown(
    video: Path,  # noqa: F811
    states: list[str],
    *assignments: Assignment,
    keep_bytes: int = 10**7,
    rests_s: float = 60.0,
) -> tuple[SourceStage, Radio]:
    radio = Radio(states)
    params = SourceParams(keep_bytes=keep_bytes, keyframe_interval_s=0.2, wait_s=rests_s)
    stage = SourceStage(stream_input(video, RATE_HZ), assignments or (assignment("d"),), radio, params)
    clock = [0.0]

    def wait_until(video_s: float | None) -> float:
        clock[0] = clock[0] if video_s is None else video_s
        radio.now_s = clock[0]
        return clock[0]

    def pause(seconds: float) -> float:
        clock[0] += seconds
        radio.now_s = clock[0]
        return clock[0]

    stage.run(wait_until, pause)
    return stage, radio


def packets(radio: Radio, detector: str = "d") -> list[Packet]:
    return [m for _, m in radio.sent if isinstance(m, Packet) and m.detector == detector]


def accounted_for(stage: SourceStage, radio: Radio, detector: str = "d") -> None:
    sent = Counter(p.index for p in packets(radio, detector))
    assert max(sent.values(), default=0) <= 1, "each once"
    dropped = {index for index, d in stage.count.dropped if d == detector}
    assert not dropped & set(sent)
    due = {index for index, detectors in stage.count.due.items() if detector in detectors}
    assert dropped | set(sent) == due
    assert [p.sequence for p in packets(radio, detector)] == list(range(sum(sent.values())))


@settings(max_examples=25, deadline=None)
@given(st.lists(st.sampled_from(["up", "up", "down", "full"]), min_size=FRAMES, max_size=FRAMES))
def test_whatever_the_link_does_every_frame_is_sent_once_and_can_be_decoded(video: Path, states) -> None:  # noqa: F811
    stage, radio = flown(video, [*states, "up"])
    accounted_for(stage, radio)
    assert not stage.count.dropped
    assert stage.count.frames_dropped.total() == 0
    pictures = {f.index: f for f in SourceStage(stream_input(video, RATE_HZ), (), radio).frames()}
    decoder = Decoder("h264")
    for packet in packets(radio):
        shown = decoder.decode(packet.data)
        filmed = pictures[packet.index].planes.to_ndarray(format="rgb24")
        assert np.abs(shown.astype(int) - filmed).mean() < 30.0, "the picture of this frame, and of no other"
        assert packet.time_ns == pictures[packet.index].time_ns


def test_what_is_filmed_does_not_wait_for_what_was_kept(video: Path) -> None:  # noqa: F811
    states = ["up"] * 4 + ["down"] * 12 + ["up"] * 20
    _, radio = flown(video, states)
    at_s = {m.index: now_s for now_s, m in radio.sent if isinstance(m, Packet)}
    order = [p.index for p in packets(radio)]
    for index in (*range(4), *range(16, 30)):
        assert at_s[index] == pytest.approx(index / RATE_HZ, abs=1e-6)
    assert order.index(16) < order.index(4), "first what is now"
    assert order.index(4) < order.index(29), "and as soon as there is room, what was"


def test_after_the_flight_the_rest_is_sent_no_faster_than_it_was_filmed(video: Path) -> None:  # noqa: F811
    states = ["up"] * 3 + ["down"] * 27 + ["up"]
    stage, radio = flown(video, states)
    accounted_for(stage, radio)
    last_s = max(now_s for now_s, m in radio.sent if isinstance(m, Packet))
    assert len(packets(radio)) == 30
    assert last_s >= 1.0 + 0.5, "27 frames are two runs"
    assert isinstance(radio.sent[-1][1], EndOfStream)


def test_where_no_way_comes_it_is_waited_for_a_while_and_the_frames_are_dropped_for_what_was_in_their_way(
    video: Path,  # noqa: F811
) -> None:
    stage, radio = flown(video, ["up"] * 10 + ["down"], rests_s=3.0)
    accounted_for(stage, radio)
    assert set(stage.count.dropped.values()) == {"link_down"}
    assert stage.count.frames_dropped == {"link_down": 20}
    assert radio.now_s == pytest.approx(29 / 30.0 + 3.0, abs=0.6)


def test_the_disk_that_it_may_take_is_bounded_and_what_has_no_room_is_dropped_at_once(video: Path) -> None:  # noqa: F811
    stage, radio = flown(video, ["down"] * 30 + ["up"], keep_bytes=20_000)
    accounted_for(stage, radio)
    assert 0 < len(stage.count.dropped) < 30
    assert min(index for index, _ in stage.count.dropped) > max(p.index for p in packets(radio))


def test_nothing_is_kept_where_nobody_asked_for_it(video: Path) -> None:  # noqa: F811
    stage, radio = flown(video, ["up"] * 10 + ["down"] * 10 + ["up"], keep_bytes=0)
    assert [p.index for p in packets(radio)] == [*range(10), *range(20, 30)]
    assert stage.count.frames_dropped == {"link_down": 10}


def test_each_detector_has_its_own_runs_and_another_bitrate_is_another_detector(video: Path) -> None:  # noqa: F811
    both = assignment("d"), assignment("e", period=2)
    stage, radio = flown(video, ["up"] * 6 + ["down"] * 14 + ["up"], *both)
    for detector in ("d", "e"):
        accounted_for(stage, radio, detector)
    assert len(packets(radio, "e")) == 15
    kept = stage._kept
    frame = next(stage.frames())
    assert kept.keep(frame, assignment("d"), "link_down")
    assert kept.take(assignment("d", bitrate_bps=2e6)) == []
    assert [p.index for p in kept.take(assignment("d"))] == [frame.index]
    assert len(kept) == 0


def test_a_disk_that_takes_nothing_costs_the_frames_and_not_the_stream(
    video: Path,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pipeline.mission.stages.kept_frames.tempfile.TemporaryFile", full)
    stage, radio = flown(video, ["up"] * 10 + ["down"] * 10 + ["up"])
    accounted_for(stage, radio)
    assert stage.count.frames_dropped == {"link_down": 10}
    assert math.isfinite(radio.now_s)

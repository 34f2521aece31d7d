import math
import time
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.allocation.plan import Assignment
from pipeline.config.telemetry import Telemetry
from pipeline.errors import RunFailedError
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory_of import Ground, trajectory_of
from pipeline.ingest.video.recordings import open_recordings
from pipeline.link.records import record_bytes
from pipeline.messages import Detections, EndOfStream, Message, Packet, pack
from pipeline.mission.controller.substreams import Opened, PlanEpoch
from pipeline.mission.stages.detector import DetectorStage
from pipeline.mission.stages.source import SourceParams, SourceStage, StreamInput
from pipeline.mission.stages.virtual_link import VirtualLink, wire_bytes
from tests.videos import packet_places

FRAMES, RATE_HZ = 30, 30.0


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("source") / "noise.mp4"
    rng = np.random.default_rng(1)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(30))
        stream.width, stream.height, stream.pix_fmt = 96, 64, "yuv420p"
        for _ in range(FRAMES):
            picture = av.VideoFrame.from_ndarray(
                rng.integers(0, 256, (64, 96, 3), dtype=np.uint8), format="rgb24"
            )
            container.mux(stream.encode(picture))
        container.mux(stream.encode())
    return path


def stream_input(video: Path, rate_hz: float) -> StreamInput:
    n = FRAMES
    zero = np.zeros(n)
    track = Track(10**18, np.arange(n) / RATE_HZ, zero, zero, zero + 20.0, zero, zero, zero - 0.7, zero)
    telemetry = Telemetry(file=Path("flight.srt"))
    ground = Ground("ellipsoid", lambda east, north: 0.0)
    trajectory = trajectory_of(track, telemetry, LocalFrame(0.0, 0.0), ground)
    return StreamInput("v", "drone", open_recordings([video]), trajectory, rate_hz, "h264")


def assignment(detector: str, period: int = 1, phase: int = 0, bitrate_bps: float = 1e6) -> Assignment:
    return Assignment("v", detector, detector, "m", "site", period, phase, bitrate_bps)


def run(video: Path, assignments: list[Assignment], bandwidth_bps: float, rate_hz: float = 10.0):  # type: ignore[no-untyped-def]
    sent: list[tuple[str, Message]] = []
    link = VirtualLink({"site": bandwidth_bps}, lambda detector, message: sent.append((detector, message)))
    stage = SourceStage(
        stream_input(video, rate_hz), tuple(assignments), link, SourceParams(max_backlog_s=0.5)
    )
    stage.run(lambda video_s: video_s)
    return stage, sent, link


def test_a_detector_of_period_p_and_phase_o_gets_the_frames_whose_tick_is_o_modulo_p(video: Path) -> None:
    _, sent, _ = run(video, [assignment("a"), assignment("b", period=3, phase=1)], float("inf"))
    indices = {d: [m.index for to, m in sent if to == d and isinstance(m, Packet)] for d in "ab"}
    assert indices == {"a": list(range(0, 30, 3)), "b": [3, 12, 21]}


def test_every_substream_ends_with_its_end_of_stream(video: Path) -> None:
    _, sent, _ = run(video, [assignment("a"), assignment("b", period=2)], float("inf"))
    for detector in "ab":
        mine = [m for to, m in sent if to == detector]
        assert mine[-1] == EndOfStream("v", detector, sequence=len(mine) - 1)
        assert all(isinstance(m, Packet) for m in mine[:-1])


def test_packets_are_numbered_without_a_gap_though_frames_were_dropped_before_they_were_encoded(
    video: Path,
) -> None:
    stage, sent, _ = run(video, [assignment("a")], 2e5)
    packets = [m for _, m in sent if isinstance(m, Packet)]
    assert stage.count.dropped, "the link is too slow for all frames"
    assert [m.sequence for m in packets] == list(range(len(packets)))


def test_captured_frames_are_those_not_sampled_and_those_due(video: Path) -> None:
    stage, _, _ = run(video, [assignment("a")], float("inf"))
    assert stage.count.captured == FRAMES == stage.count.not_sampled + len(stage.count.due)


def test_a_link_that_is_too_slow_drops_frames_before_they_are_encoded_and_says_so(video: Path) -> None:
    stage, sent, link = run(video, [assignment("a", bitrate_bps=2e6)], 2e5, rate_hz=30.0)
    packets = [m for _, m in sent if isinstance(m, Packet)]
    assert 0 < stage.count.frames_dropped["link_full"] == FRAMES - len(packets)
    assert set(stage.count.dropped.values()) == {"link_full"}
    assert sum(wire_bytes(m) for _, m in sent) == link.bytes_sent["site"]


def test_the_first_packet_of_a_substream_stands_alone(video: Path) -> None:
    _, sent, _ = run(video, [assignment("a")], float("inf"))
    assert isinstance(sent[0][1], Packet)
    assert sent[0][1].keyframe


def test_a_packet_carries_capture_time_and_what_the_link_needed(video: Path) -> None:
    _, sent, _ = run(video, [assignment("a")], 1e6)
    packets = [m for _, m in sent if isinstance(m, Packet)]
    assert [p.time_ns - 10**18 for p in packets] == [pytest.approx(k * 1e8, abs=1e3) for k in range(10)]
    assert all(p.link_s > 0 for p in packets[1:])


def test_a_packet_says_how_late_its_frame_was_and_encoding_is_apart(video: Path) -> None:
    packets: list[Message] = []
    link = VirtualLink({"site": math.inf}, lambda _, message: packets.append(message))
    stage = SourceStage(stream_input(video, 10.0), (assignment("d"), assignment("e")), link)
    frame = next(stage.frames())
    stage.offer(frame, 0.5, late_s=0.5)
    first, second = packets
    assert isinstance(first, Packet)
    assert isinstance(second, Packet)
    assert first.source_s == pytest.approx(0.5, abs=0.4)
    assert first.source_s >= 0.5
    assert second.source_s >= first.source_s + first.encode_s, "it waits for the encoding of the first"


def test_a_frame_that_comes_too_late_is_dropped_as_late(video: Path) -> None:
    link = VirtualLink({"site": float("inf")}, lambda detector, message: None)
    stage = SourceStage(stream_input(video, 10.0), (assignment("a"),), link, SourceParams(max_backlog_s=0.5))
    stage.run(lambda video_s: video_s + 1.0)
    assert stage.count.frames_dropped == {"source_late": 10}


def test_a_refused_packet_makes_the_next_one_stand_alone(video: Path) -> None:
    class Refusing(VirtualLink):
        offers = 0

        def send(self, site: str, detector: str, message: Message, now_s: float) -> bool:
            self.offers += 1
            return self.offers != 4 and super().send(site, detector, message, now_s)

    sent: list[Packet] = []
    link = Refusing({"site": float("inf")}, lambda _, m: sent.append(m) if isinstance(m, Packet) else None)
    stage = SourceStage(stream_input(video, 30.0), (assignment("a"),), link, SourceParams(max_backlog_s=0.5))
    stage.run(lambda video_s: video_s)
    assert stage.count.frames_dropped == {"receiver_busy": 1}
    assert [p.index for p in sent if p.keyframe][:2] == [0, 4]


def test_frames_without_a_pose_are_counted_as_such_and_are_nobodys_turn(video: Path) -> None:
    stream = stream_input(video, 10.0)
    stream = replace(stream, trajectory=replace(stream.trajectory, end_s=0.45))
    link = VirtualLink({"site": float("inf")}, lambda detector, message: None)
    stage = SourceStage(stream, (assignment("a"),), link, SourceParams(max_backlog_s=0.5))
    stage.run(lambda video_s: video_s)
    assert stage.count.lost == dict.fromkeys((15, 18, 21, 24, 27), "no_pose")
    assert set(stage.count.due) == {0, 3, 6, 9, 12}
    assert stage.count.captured == FRAMES == stage.count.not_sampled + 10


def test_a_damaged_picture_is_dropped_as_damaged_and_the_run_goes_on(video: Path, tmp_path: Path) -> None:
    start, size, _ = packet_places(video)[9]
    data = bytearray(video.read_bytes())
    data[start : start + size] = bytes(0xFF for _ in range(size))
    damaged = tmp_path / "damaged.mp4"
    damaged.write_bytes(data)
    stage, sent, _ = run(damaged, [assignment("a")], float("inf"), rate_hz=30.0)
    packets = [m for _, m in sent if isinstance(m, Packet)]
    assert stage.count.lost[9] == "damaged"
    assert stage.count.captured == FRAMES == len(packets) + len(stage.count.lost)
    assert stage.count.frames_dropped["damaged"] == len(stage.count.lost) < 5


def test_a_part_of_a_video_begins_at_once_and_keeps_its_times(video: Path) -> None:
    stream = stream_input(video, 10.0)
    stream = replace(stream, source=open_recordings([video], 0.5, 0.8))
    waits: list[float] = []
    packets: list[Packet] = []
    link = VirtualLink({"site": math.inf}, lambda _, m: packets.append(m) if isinstance(m, Packet) else None)
    SourceStage(stream, (assignment("a"),), link).run(lambda video_s: waits.append(video_s) or video_s)
    assert waits == pytest.approx([0.0, 0.1, 0.2])
    assert [p.time_ns - 10**18 for p in packets] == [pytest.approx(k * 1e8, abs=1e3) for k in (5, 6, 7)]
    assert [p.index for p in packets] == [15, 18, 21]


def test_boxes_are_in_pixels_of_the_picture_that_was_filmed_whatever_was_sent(video: Path) -> None:
    class OneBox:
        def detect(self, image: np.ndarray):  # type: ignore[no-untyped-def, type-arg]
            sizes.append(image.shape)
            height, width = image.shape[:2]
            return np.array([[0.25 * width, 0.5 * height, width, height]]), np.ones(1), np.zeros(1, np.int64)

    sizes: list[tuple[int, ...]] = []
    found: list[Message] = []
    detector = DetectorStage(OneBox(), "h264")  # type: ignore[arg-type]
    link = VirtualLink({"site": math.inf}, lambda _, m: found.append(detector.process(m, 0)))
    stream = stream_input(video, 10.0)
    stream = replace(stream, source=stream.source.resized(48, 32))
    SourceStage(stream, (assignment("a"),), link).run(lambda video_s: video_s)
    assert set(sizes) == {(32, 48, 3)}
    boxes = [m.boxes_px for m in found if isinstance(m, Detections)]
    assert len(boxes) == 10
    assert np.array(boxes) == pytest.approx(np.array([[[24.0, 32.0, 96.0, 64.0]]] * 10))


class Faulty(VirtualLink):
    """A link that says of each frame, by its number, what it is told to say."""

    def __init__(self, sent: list[Message], **says: dict[int, object]) -> None:
        super().__init__({"site": math.inf}, lambda _, message: sent.append(message))
        self.says, self.frame = says, -1

    def at(self, what: str, otherwise: object) -> object:
        return self.says.get(what, {}).get(self.frame, otherwise)

    def is_up(self, site: str, detector: str) -> bool:
        return self.at("down", False) is False

    def backlog_s(self, site: str, now_s: float) -> float:
        return float(self.at("backlog_s", 0.0))  # type: ignore[arg-type]

    def take_restarts(self) -> set[str]:
        self.frame += 1  # asked once for each frame
        return self.at("restarts", set())  # type: ignore[return-value]

    def take_lost(self) -> list[Packet]:
        return self.says.get("lost", {}).pop(self.frame, [])  # type: ignore[return-value]


def faulty(video: Path, params: SourceParams, **says: dict[int, object]) -> tuple[SourceStage, list[Packet]]:
    sent: list[Message] = []
    stage = SourceStage(stream_input(video, 30.0), (assignment("a"),), Faulty(sent, **says), params)
    stage.run(lambda video_s: video_s)
    return stage, [m for m in sent if isinstance(m, Packet)]


def test_a_frame_that_is_bound_to_be_too_old_is_dropped_before_it_is_encoded(video: Path) -> None:
    params = SourceParams(max_backlog_s=1.0, most_age_s=0.4)
    stage, packets = faulty(video, params, backlog_s={3: 0.3, 4: 0.5, 5: 0.5, 6: 1.1, 7: 0.4})
    assert stage.count.dropped == {(4, "a"): "too_old", (5, "a"): "too_old", (6, "a"): "link_full"}
    assert stage.count.frames_dropped == {"too_old": 2, "link_full": 1}
    assert [p.index for p in packets] == [i for i in range(FRAMES) if i not in (4, 5, 6)]
    assert [p.index for p in packets if p.keyframe] == [0], "nothing was encoded in vain"


def test_lateness_and_backlog_together_make_a_frame_too_old(video: Path) -> None:
    link = VirtualLink({"site": math.inf}, lambda detector, message: None)
    for late_s, dropped in ((0.3, {}), (0.41, {"too_old": 10}), (1.1, {"source_late": 10})):
        stage = SourceStage(stream_input(video, 10.0), (assignment("a"),), link, SourceParams(most_age_s=0.4))
        stage.run(lambda video_s, late_s=late_s: video_s + late_s)  # type: ignore[misc]
        assert stage.count.frames_dropped == dropped


def test_nothing_is_encoded_for_a_link_that_is_down(video: Path) -> None:
    stage, packets = faulty(video, SourceParams(), down={5: True, 6: True})
    assert stage.count.frames_dropped == {"link_down": 2}
    assert [p.sequence for p in packets] == list(range(FRAMES - 2))


def test_a_substream_begins_anew_where_the_far_end_asks_for_it(video: Path) -> None:
    _, packets = faulty(video, SourceParams(), restarts={4: {"a"}, 9: {"another"}})
    assert [p.index for p in packets if p.keyframe] == [0, 4]


def test_what_was_sent_and_lost_is_counted_so(video: Path) -> None:
    lost = [Packet("v", "a", i, 0, 0, 1, 30, False, None, b"") for i in (2, 3)]  # type: ignore[arg-type]
    stage, _ = faulty(video, SourceParams(), lost={6: lost})
    assert stage.count.dropped == {(2, "a"): "link_lost", (3, "a"): "link_lost"}
    assert stage.count.frames_dropped == {"link_lost": 2}


def test_a_frame_that_another_detector_still_has_is_not_lost_to_the_stream(video: Path) -> None:
    link = VirtualLink({"site": math.inf}, lambda detector, message: None)
    stage = SourceStage(stream_input(video, 30.0), (assignment("a"), assignment("b")), link)
    stage.run(lambda video_s: video_s)
    stage.count.lose_sent(2, "a", "link_lost")
    assert stage.count.frames_dropped == {}
    stage.count.lose_sent(2, "b", "link_lost")
    assert stage.count.frames_dropped == {"link_lost": 1}


def test_an_end_that_cannot_be_told_is_an_error_that_names_whom(video: Path) -> None:
    class Deaf(VirtualLink):
        def send(self, site: str, detector: str, message: Message, now_s: float) -> bool:
            return not isinstance(message, EndOfStream)

    stage = SourceStage(stream_input(video, 30.0), (assignment("a"),), Deaf({"site": math.inf}, print))
    with pytest.raises(RunFailedError, match="stream v: its end did not reach a at site"):
        stage.run(lambda video_s: video_s)


@pytest.mark.parametrize(
    "wrong", [{"max_backlog_s": 0.0}, {"most_age_s": -1.0}, {"keyframe_interval_s": 0.0}]
)
def test_limits_that_let_nothing_through_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected times above 0"):
        SourceParams(**wrong)


def test_a_link_in_video_time_charges_heads_and_ends_as_a_connection_does(video: Path) -> None:
    _, sent, link = run(video, [assignment("a")], 1e6)
    data = sum(len(m.data) for _, m in sent if isinstance(m, Packet))
    stamped = [replace(m, sent_ns=time.time_ns()) if isinstance(m, Packet) else m for _, m in sent]
    assert (
        link.bytes_sent["site"] == sum(record_bytes(pack(m)) for m in stamped) > data + 180 * (len(sent) - 1)
    )


def opened(epoch: int, detector: str, period: int = 1, phase: int = 0, bitrate_bps: float = 1e6) -> Opened:
    return Opened(epoch, assignment(detector, period, phase, bitrate_bps))


def switched(video: Path, first: list[Assignment], then: PlanEpoch, before_frame: int):  # type: ignore[no-untyped-def]
    """What is sent when another epoch is followed from a frame on."""
    sent: list[tuple[str, Message]] = []
    link = VirtualLink({"site": math.inf}, lambda detector, message: sent.append((detector, message)))
    stage = SourceStage(stream_input(video, 10.0), tuple(first), link)
    for number, taken in enumerate(stage.frames()):
        if number == before_frame:
            stage.follow(then, taken.time_s)
        stage.offer(taken, taken.time_s)
    stage.end()
    return stage, sent


def test_every_frame_of_a_switch_is_sent_under_one_epoch_only(video: Path) -> None:
    _, sent = switched(video, [assignment("a")], PlanEpoch("v", 1, (opened(1, "b"),)), 4)
    ticks = {d: [m.index // 3 for to, m in sent if to == d and isinstance(m, Packet)] for d in "ab"}
    assert ticks == {"a": [0, 1, 2, 3], "b": [4, 5, 6, 7, 8, 9]}


def test_the_left_detector_gets_its_end_and_the_new_one_begins_with_a_picture_that_stands_alone(
    video: Path,
) -> None:
    _, sent = switched(video, [assignment("a")], PlanEpoch("v", 1, (opened(1, "b"),)), 4)
    assert [m for to, m in sent if to == "a"][-1] == EndOfStream("v", "a", 0, 4)
    first = next(m for to, m in sent if to == "b")
    assert (first.keyframe, first.epoch, first.sequence) == (True, 1, 0)
    assert sent[-1] == ("b", EndOfStream("v", "b", 1, 6))


def test_a_detector_that_goes_on_notices_nothing_but_its_phase(video: Path) -> None:
    then = PlanEpoch("v", 1, (opened(0, "a", 2, 1), opened(1, "b", 2, 0)))
    _, sent = switched(video, [assignment("a", 2, 0)], then, 4)
    mine = [m for to, m in sent if to == "a"]
    assert [m.index // 3 for m in mine[:-1]] == [0, 2, 5, 7, 9]
    assert [m.sequence for m in mine] == [0, 1, 2, 3, 4, 5]
    assert [m.keyframe for m in mine[:-1]] == [True, False, False, False, False]
    assert {m.epoch for m in mine} == {0}


def test_the_same_detector_opened_again_is_another_substream(video: Path) -> None:
    _, sent = switched(video, [assignment("a")], PlanEpoch("v", 1, (opened(1, "a", bitrate_bps=5e5),)), 4)
    mine = [(m.epoch, m.sequence, isinstance(m, EndOfStream)) for _, m in sent]
    assert mine[:5] == [(0, 0, False), (0, 1, False), (0, 2, False), (0, 3, False), (0, 4, True)]
    assert mine[5] == (1, 0, False)
    assert mine[-1] == (1, 6, True)


def test_a_stream_that_nobody_looks_at_counts_its_frames_as_not_assigned(video: Path) -> None:
    stage, sent = switched(video, [assignment("a")], PlanEpoch("v", 1), 4)
    assert stage.count.frames_dropped == {"not_assigned": 6}
    assert len(sent) == 5


def test_an_end_that_cannot_be_told_is_said_and_the_new_epoch_is_followed_all_the_same(video: Path) -> None:
    class Deaf(VirtualLink):
        def send(self, site: str, detector: str, message: Message, now_s: float) -> bool:
            return not isinstance(message, EndOfStream)

    stage = SourceStage(
        stream_input(video, 10.0), (assignment("a"),), Deaf({"site": math.inf}, lambda *_: None)
    )
    with pytest.raises(RunFailedError, match="its end did not reach a at site"):
        stage.follow(PlanEpoch("v", 1, (opened(1, "b"),)), 0.0)
    assert stage.epoch == PlanEpoch("v", 1, (opened(1, "b"),))

import math
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.allocation.plan import Assignment
from pipeline.config.telemetry import Telemetry
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory_of import Ground, trajectory_of
from pipeline.ingest.video.recordings import open_recordings
from pipeline.messages import Detections, EndOfStream, Message, Packet
from pipeline.mission.stages.detector import DetectorStage
from pipeline.mission.stages.source import SourceStage, StreamInput
from pipeline.mission.stages.virtual_link import VirtualLink
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
    stage = SourceStage(stream_input(video, rate_hz), tuple(assignments), link, max_backlog_s=0.5)
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
    assert sum(len(p.data) for p in packets) == link.bytes_sent["site"]


def test_the_first_packet_of_a_substream_stands_alone(video: Path) -> None:
    _, sent, _ = run(video, [assignment("a")], float("inf"))
    assert isinstance(sent[0][1], Packet)
    assert sent[0][1].keyframe


def test_a_packet_carries_capture_time_and_what_the_link_needed(video: Path) -> None:
    _, sent, _ = run(video, [assignment("a")], 1e6)
    packets = [m for _, m in sent if isinstance(m, Packet)]
    assert [p.time_ns - 10**18 for p in packets] == [pytest.approx(k * 1e8, abs=1e3) for k in range(10)]
    assert all(p.link_s > 0 for p in packets[1:])


def test_a_frame_that_comes_too_late_is_dropped_as_late(video: Path) -> None:
    link = VirtualLink({"site": float("inf")}, lambda detector, message: None)
    stage = SourceStage(stream_input(video, 10.0), (assignment("a"),), link, max_backlog_s=0.5)
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
    stage = SourceStage(stream_input(video, 30.0), (assignment("a"),), link, max_backlog_s=0.5)
    stage.run(lambda video_s: video_s)
    assert stage.count.frames_dropped == {"receiver_busy": 1}
    assert [p.index for p in sent if p.keyframe][:2] == [0, 4]


def test_frames_without_a_pose_are_counted_as_such_and_are_nobodys_turn(video: Path) -> None:
    stream = stream_input(video, 10.0)
    stream = replace(stream, trajectory=replace(stream.trajectory, end_s=0.45))
    link = VirtualLink({"site": float("inf")}, lambda detector, message: None)
    stage = SourceStage(stream, (assignment("a"),), link, max_backlog_s=0.5)
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
    SourceStage(stream, (assignment("a"),), link, 0.5).run(lambda video_s: waits.append(video_s) or video_s)
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
    SourceStage(stream, (assignment("a"),), link, 0.5).run(lambda video_s: video_s)
    assert set(sizes) == {(32, 48, 3)}
    boxes = [m.boxes_px for m in found if isinstance(m, Detections)]
    assert len(boxes) == 10
    assert np.array(boxes) == pytest.approx(np.array([[[24.0, 32.0, 96.0, 64.0]]] * 10))

"""One stream over real connections: as in video time, past machines that hang, and whatever the clocks do."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest

from actors.source import SourceActor
from pipeline.allocation.plan import Assignment
from pipeline.clock import Clock
from pipeline.config.telemetry import Telemetry
from pipeline.errors import RunFailedError
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory_of import Ground, trajectory_of
from pipeline.ingest.video.recordings import open_recordings
from pipeline.link.codec import Decoder
from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.receiver import Receiver
from pipeline.messages import Dropped, EndOfStream, Message, Packet
from pipeline.mission.controller.orders import Send
from pipeline.mission.controller.substreams import Opened, PlanEpoch
from pipeline.mission.stages.inbox import Inbox, InboxParams
from pipeline.mission.stages.radio_link import RadioLink
from pipeline.mission.stages.source import SourceParams, SourceStage, StreamInput
from pipeline.mission.stages.virtual_link import VirtualLink
from tests.integration.throttled_relay import ThrottledRelay

KEYS = KeyPair()
PEERS = {KEYS.public: "a peer"}
SECONDS, RATE_HZ = 6, 10.0
WAIT_S = 20.0


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> StreamInput:
    """Six seconds of noise, which no encoder makes small."""
    path = tmp_path_factory.mktemp("radio") / "noise.mp4"
    rng = np.random.default_rng(1)
    with av.open(str(path), "w") as container:
        video = container.add_stream("mpeg4", rate=Fraction(10), options={"qscale": "2"})
        video.width, video.height, video.pix_fmt = 160, 128, "yuv420p"
        for _ in range(round(SECONDS * RATE_HZ)):
            noise = rng.integers(0, 256, (128, 160, 3), dtype=np.uint8)
            container.mux(video.encode(av.VideoFrame.from_ndarray(noise, format="rgb24")))
        container.mux(video.encode())
    n = 10 * SECONDS
    zero = np.zeros(n)
    track = Track(10**18, np.arange(n) / 10.0, zero, zero, zero + 20.0, zero, zero, zero - 0.7, zero)
    ground = Ground("ellipsoid", lambda east, north: 0.0)
    trajectory = trajectory_of(track, Telemetry(file=Path("flight.srt")), LocalFrame(0.0, 0.0), ground)
    return StreamInput("v", "drone", open_recordings([path]), trajectory, RATE_HZ, "h264")


def assignment(detector: str, period: int = 1, phase: int = 0, bitrate_bps: float = 1e6) -> Assignment:
    return Assignment("v", detector, detector, "m", "site", period, phase, bitrate_bps)


def realtime() -> Callable[[float], float]:
    start_s = time.monotonic()

    def wait_until(video_s: float) -> float:
        time.sleep(max(0.0, start_s + video_s - time.monotonic()))
        return time.monotonic() - start_s

    return wait_until


@pytest.fixture
def far_end() -> Iterator[Callable[[Callable[[Message], None]], Receiver]]:
    receivers: list[Receiver] = []

    def make(take: Callable[[Message], None]) -> Receiver:
        receivers.append(Receiver("127.0.0.1", take, keys=KEYS, peers=PEERS))
        return receivers[-1]

    yield make
    for receiver in receivers:
        receiver.close()


@pytest.mark.parametrize("scale", [pytest.param(1.0, marks=pytest.mark.slow), 0.15])
def test_real_and_virtual_link_send_and_drop_the_same_of_one_plan(
    stream: StreamInput,
    far_end,  # type: ignore[no-untyped-def]
    scale: float,
) -> None:
    """A plan that asks for 1.5 times of what the link has; heads are a tenth of the bytes of the smaller one."""
    plan = (assignment("a", bitrate_bps=scale * 1e6), assignment("b", 2, 1, bitrate_bps=scale * 1e6))
    bandwidth, params = {"site": scale * 1e6}, SourceParams(max_backlog_s=0.5)
    virtual_sent: list[Message] = []
    virtual = VirtualLink(bandwidth, lambda _, message: virtual_sent.append(message))
    expected = SourceStage(stream, plan, virtual, params)
    expected.run(lambda video_s: video_s)

    got: list[Message] = []
    receiver = far_end(got.append)
    link = RadioLink("v", bandwidth, KEYS)
    for a in plan:
        link.connect(a.site, a.detector, receiver.endpoint)
    stage = SourceStage(stream, plan, link, params)
    stage.run(realtime())
    assert len(receiver._peers) == 1, "one connection for both substreams"
    assert link.close() == []

    assert link.bytes_sent["site"] == pytest.approx(virtual.bytes_sent["site"], rel=0.1)
    reasons, wanted = list(stage.count.dropped.values()), list(expected.count.dropped.values())
    assert set(reasons) == set(wanted) == {"link_full"}
    assert len(wanted) > 10
    assert len(reasons) == pytest.approx(len(wanted), abs=8)
    packets = [m for m in got if isinstance(m, Packet)]
    assert len(packets) + len(reasons) == sum(len(due) for due in stage.count.due.values())
    assert [type(m) for m in got[-2:]] == [EndOfStream, EndOfStream]


def test_a_site_that_cannot_be_reached_is_an_error_with_the_names_of_both_ends() -> None:
    link = RadioLink("drone-1", {"ground": 1e6}, KEYS)
    with pytest.raises(
        RunFailedError, match=r"stream drone-1: no connection to ground at 127\.0\.0\.1:1: .*refused"
    ):
        link.connect("ground", "small", Endpoint("127.0.0.1", 1, KEYS.public))
    link.close()


def test_a_detector_that_hangs_holds_up_no_other_and_goes_on_with_a_key_frame(
    stream: StreamInput, far_end
) -> None:  # type: ignore[no-untyped-def]
    plan = (assignment("hangs", bitrate_bps=5e5), assignment("works", bitrate_bps=5e5))
    done: dict[str, list[Message]] = {"hangs": [], "works": []}
    dropped: list[Dropped] = []
    resume = threading.Event()
    receiver: Receiver

    def inbox(detector: str) -> Inbox:
        return Inbox(
            InboxParams(packets=4, max_wait_s=100.0),
            Clock(),
            drops=True,
            on_drop=dropped.append,
            want_restart=lambda: receiver.want_restart("v", detector),
        )

    inboxes = {a.detector: inbox(a.detector) for a in plan}

    def work(detector: str) -> None:
        while not isinstance(message := inboxes[detector].get().message, EndOfStream):
            if detector == "hangs" and len(done[detector]) == 10:
                resume.wait(WAIT_S)
            done[detector].append(message)

    workers = [threading.Thread(target=work, args=(a.detector,), daemon=True) for a in plan]
    for worker in workers:
        worker.start()
    receiver = far_end(lambda message: inboxes[message.detector].put(message))
    link = RadioLink("v", {"site": 4e6}, KEYS)
    for a in plan:
        link.connect(a.site, a.detector, receiver.endpoint)
    params = SourceParams(max_backlog_s=5.0, keyframe_interval_s=100.0)  # none but the one that is asked for
    stage = SourceStage(stream, plan, link, params)
    threading.Timer(3.5, resume.set).start()
    stage.run(realtime())
    assert link.close() == []
    for worker in workers:
        worker.join(WAIT_S)
    assert len(done["works"]) == SECONDS * RATE_HZ
    assert stage.count.dropped == {}
    assert {d.detector for d in dropped} == {"hangs"}
    indices = [m.index for m in done["hangs"] if isinstance(m, Packet)]
    assert sorted(indices + [d.index for d in dropped]) == list(range(round(SECONDS * RATE_HZ)))
    assert len(dropped) > 5
    decoder = Decoder("h264")
    for message in done["hangs"]:
        assert isinstance(message, Packet)
        decoder.decode(message.data)
    gap = next(i for i in range(1, len(indices)) if indices[i] != indices[i - 1] + 1)
    after = done["hangs"][gap]
    assert isinstance(after, Packet)
    assert after.keyframe
    assert after.index - dropped[-1].index == 1
    assert len(indices) > gap + 5, "it went on soon after it could"


def test_a_cut_link_is_made_again_and_every_frame_is_accounted_for(stream: StreamInput, far_end) -> None:  # type: ignore[no-untyped-def]
    got: list[Message] = []
    told: list[tuple[str, str, str]] = []
    receiver = far_end(got.append)
    relay = ThrottledRelay(receiver.endpoint.address, 50e6)
    link = RadioLink("v", {"site": 4e6}, KEYS, on_lost=lambda *what: told.append(what))
    link.connect("site", "a", Endpoint(*relay.address, KEYS.public))
    stage = SourceStage(stream, (assignment("a"),), link, SourceParams())
    threading.Timer(2.05, relay.cut).start()
    stage.run(realtime())
    assert link.close() == []
    relay.close()
    assert [what[0] for what in told] == ["site"]
    packets = [m for m in got if isinstance(m, Packet)]
    lost = {index for (index, _), reason in stage.count.dropped.items()}
    assert set(stage.count.dropped.values()) <= {"link_down", "link_lost", "receiver_busy"}
    assert {p.index for p in packets} | lost == set(range(round(SECONDS * RATE_HZ)))
    assert len(lost) < 10
    broken = [a for b, a in pairwise(packets) if a.index != b.index + 1]
    assert all(p.keyframe for p in broken)
    assert isinstance(got[-1], EndOfStream)


@pytest.mark.parametrize("step_s", [5.0, pytest.param(-5.0, marks=pytest.mark.slow)])
def test_a_wall_clock_that_jumps_moves_nothing_but_stamps(
    stream: StreamInput, far_end, step_s: float
) -> None:  # type: ignore[no-untyped-def]
    begin_ns, begin_s = time.time_ns(), time.monotonic()

    def utc_ns() -> int:
        """As of begin, then step_s off after two seconds."""
        passed_s = time.monotonic() - begin_s
        return begin_ns + round((passed_s + (step_s if passed_s > 2.0 else 0.0)) * 1e9)

    got: list[tuple[float, Message]] = []
    receiver = far_end(lambda message: got.append((time.monotonic() - begin_s, message)))
    patient = SourceParams(max_backlog_s=4.0)  # a busy machine is late by less, the jump by more
    actor = SourceActor(stream, (), {"site": 4e6}, patient, clock=Clock(utc_ns=utc_ns))
    first = assignment("a")
    actor.follow(Send(PlanEpoch(stream.stream, 0, (Opened(0, first),))), {first.machine: receiver.endpoint})
    receiver.accept_only({actor.public_key(): "source:v"})
    actor.film(begin_ns * 1e-9 + 0.5)
    while not (status := actor.status()).finished and status.error is None:
        time.sleep(0.05)
    assert status.error is None
    assert actor.count().dropped == {}
    arrivals = [(at_s, m) for at_s, m in got if isinstance(m, Packet)]
    assert len(arrivals) == SECONDS * RATE_HZ
    lateness_s = [at_s - 0.5 - m.index / RATE_HZ for at_s, m in arrivals]
    assert max(lateness_s) < 4.0
    assert sorted(lateness_s)[len(lateness_s) // 2] < 1.0
    assert min(lateness_s) > -0.05
    stamps_s = [m.sent_ns * 1e-9 - begin_ns * 1e-9 - at_s for at_s, m in arrivals]
    assert max(stamps_s, key=abs) == pytest.approx(step_s, abs=0.5), "the clock did jump"
    assert status.links["site"].down == {}
    assert status.links["site"].rate_bps == 4e6

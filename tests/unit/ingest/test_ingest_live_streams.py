"""Live streams from real servers and senders on loopback."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from tstrans import mpegts, rtp, srt
from tstrans.exceptions import SrtError

from pipeline.config.live import Live
from pipeline.config.stream_url import StreamUrl
from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.live.probe import probe_live
from pipeline.ingest.live.source import INDICES
from pipeline.ingest.source import LostPicture
from tests.dialects.demo import DEMO
from tests.live_sender import Order, start
from tests.rtsp_camera import RtspCamera
from tests.unit.ingest.live_streams import Way, encoded, free_port, live_source, read, taken, transport_stream

pytestmark = pytest.mark.timeout(60)


def test_udp_is_joined_late_falls_silent_and_comes_back_with_other_parameters(tmp_path: Path) -> None:
    port = free_port()
    url, way = f"udp://127.0.0.1:{port}", Way()
    source = live_source(url, way, stall=0.5, reconnect=0.8, record=str(tmp_path))
    # pictures that nobody hears, up to the middle of a group
    first = start(Order(f"{url}?pkt_size=1316", seconds=None, track=str(DEMO / "drone-1.srt")))
    time.sleep(1.5)
    with read(source) as until:
        came = until(lambda c: len(taken(c)) >= 15)
        assert (source.health.state, source.health.basis) == ("flows", "klv")
        now_s = (time.time_ns() - source.start_ns) * 1e-9
        assert abs(came[-1].time_s - now_s) < 0.5
        assert float(way.tracks[-1].times_s[-1]) == pytest.approx(came[-1].time_s, abs=0.3)
        first.kill()
        silent_s = time.monotonic()
        until(lambda c: source.health.state == "silent")
        assert time.monotonic() - silent_s < 2.0
        before = len(taken(came))
        again = start(Order(f"{url}?pkt_size=1316", seconds=None, size=(320, 240), first_pts_s=77.0))
        came = until(lambda c: len(taken(c)) >= before + 5)
        assert source.health.state == "flows"
        again.kill()
    pictures = taken(came)
    assert {(p.planes.width, p.planes.height) for p in pictures} == {(160, 120)}
    assert [item.index for item in came] == list(range(len(came)))
    assert all(a.time_s < b.time_s and a.tick < b.tick for a, b in pairwise(pictures))
    # what was recorded of both connections is what was seen
    seen = {p.time_s: p.image for p in pictures}
    again = dict(source.images_at([*seen, 1e6]))
    assert len(again) >= len(seen) - 2
    for time_s, image in again.items():
        assert image.shape == (120, 160, 3)
        assert float(np.abs(image.astype(float) - seen[time_s]).mean()) < 3.0


def test_pictures_of_another_shape_are_of_another_camera_and_are_lost() -> None:
    port = free_port()
    source = live_source(f"udp://127.0.0.1:{port}", size=(160, 90))
    sender = start(Order(f"udp://127.0.0.1:{port}?pkt_size=1316", seconds=None))
    with read(source) as until:
        came = until(lambda c: sum(isinstance(i, LostPicture) for i in c) >= 3)
    sender.kill()
    assert not taken(came)
    assert {item.reason for item in came if isinstance(item, LostPicture)} == {"other_shape"}


@pytest.mark.slow
def test_a_source_that_another_process_reads_on_numbers_its_pictures_anew() -> None:
    port = free_port()
    source = live_source(f"udp://127.0.0.1:{port}").again(2)
    sender = start(Order(f"udp://127.0.0.1:{port}?pkt_size=1316", seconds=None))
    with read(source) as until:
        came = until(lambda c: len(c) >= 2)
    sender.kill()
    assert came[0].index == 2 * INDICES


@pytest.fixture(scope="module")
def rtsp() -> Iterator[str]:
    """Address of tstrans' server, which wants a password, without the scheme."""
    auth = rtp.BasicAuth("pilot", "geheim", realm="drone")
    server = rtp.RtspServer.start(rtp.RtspServerConfig(bind_addr="127.0.0.1:0", auth=auth))
    program = mpegts.MuxerProgramConfigBuilder(1, 0x100).add_video(0x101, mpegts.VideoCodec.H264)
    mount = server.add_unicast_mount("/live", program.pcr_pid(0x101).build())
    stop, pictures = threading.Event(), encoded(10)

    def push() -> None:
        number = 0
        while not stop.wait(0.1):
            data = pictures[number % 10]
            mount.push_video(data, pts=mpegts.Pts90khz(90_000 + 9_000 * number), key_frame=number % 10 == 0)
            number += 1

    threading.Thread(target=push, daemon=True).start()
    yield str(server.local_addr())
    stop.set()
    server.cancel_handle().cancel()


def test_rtsp_with_its_password_gives_pictures_and_those_that_came_at_once_were_not_taken_at_once(
    rtsp: str,
) -> None:
    source = live_source(f"rtsp://pilot:geheim@{rtsp}/live")
    with read(source) as until:
        came = until(lambda c: len(taken(c)) >= 5)
    assert not [item for item in came if isinstance(item, LostPicture)]
    steps = [b.time_s - a.time_s for a, b in pairwise(came)]
    assert steps == pytest.approx([0.1] * len(steps), abs=0.06)


def _refused(url: str, wait_s: float = 1.0, telemetry: str | None = None) -> InputError:
    seen = StreamUrl(url)
    told = Telemetry.model_validate({"file": telemetry or url})
    live = Live.model_validate({"wait": {"seconds": wait_s}})
    with pytest.raises(InputError) as caught:
        probe_live("mission.yaml streams.one", "one", seen, live, told)
    return caught.value


def test_a_wrong_password_none_and_a_wrong_name_are_told_at_once_and_the_password_to_nobody(
    rtsp: str,
) -> None:
    began_s = time.monotonic()
    for url, reason in (
        (f"rtsp://{rtsp}/live", "it wants a password"),
        (f"rtsp://pilot:falsch@{rtsp}/live", "the password that was given is refused"),
        (f"rtsp://pilot:geheim@{rtsp}/other", "no stream of this name"),
    ):
        error = _refused(url, 10.0)
        assert reason in error.found
        assert "falsch" not in str(error)
        assert "geheim" not in str(error)
    assert time.monotonic() - began_s < 3.0


@pytest.mark.parametrize("scheme", ["rtsp", "rtmp", "srt", "udp"])
def test_where_nobody_sends_that_is_said_within_the_time(scheme: str) -> None:
    began_s = time.monotonic()
    error = _refused(f"{scheme}://127.0.0.1:{free_port()}/live", 0.5)
    assert time.monotonic() - began_s < 3.0
    assert error.where == "mission.yaml streams.one.video"
    assert any(reason in error.found for reason in ("refused", "nothing came", "timed out"))


def test_what_is_no_video_is_told() -> None:
    port, stop = free_port(), threading.Event()

    def noise() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not stop.wait(0.01):
                out.sendto(b"\0" * 1316, ("127.0.0.1", port))

    threading.Thread(target=noise, daemon=True).start()
    error = _refused(f"udp://127.0.0.1:{port}", 1.0)
    stop.set()
    assert "no video" in error.found or "nothing came" in error.found


@pytest.mark.slow
def test_pictures_without_a_position_are_told_and_what_would_be_right() -> None:
    port = free_port()
    sender = start(Order(f"udp://127.0.0.1:{port}?pkt_size=1316", seconds=None))
    error = _refused(f"udp://127.0.0.1:{port}", 2.5)
    sender.kill()
    assert "no position in KLV" in error.found
    assert "MAVLink" in error.expected


@pytest.mark.slow
def test_rtmp_is_waited_for_and_called_and_who_ended_it_and_is_not_back_is_over() -> None:
    port = free_port()
    source = live_source(f"rtmp://127.0.0.1:{port}/live/x?listen=1", over_after=1.0)
    with read(source) as until:
        until(lambda c: source.health.state == "waiting", 0.1)
        sender = start(Order(f"rtmp://127.0.0.1:{port}/live/x", "flv", seconds=2.5))
        came = until(lambda c: source.health.state == "over")
        assert sender.wait() == 0
    assert len(taken(came)) > 10


@pytest.mark.slow
def test_srt_wants_its_passphrase() -> None:
    port, stop = free_port(), threading.Event()
    data = transport_stream(4.0)

    def serve() -> None:
        listening = srt.Builder(f"srt://127.0.0.1:{port}?mode=listener").listener().passphrase("geheim12345")
        with listening.listen() as listener:
            while not stop.is_set():
                try:
                    _pour(listener.accept(timeout_ms=500).into_sender(), data, 4.0)
                except SrtError:
                    continue

    threading.Thread(target=serve, daemon=True).start()
    error = _refused(f"srt://127.0.0.1:{port}?passphrase=falsch12345", 10.0)
    assert error.found.endswith("?passphrase=***: the passphrase that was given is refused")
    source = live_source(f"srt://127.0.0.1:{port}?passphrase=geheim12345", over_after=1.0)
    with read(source) as until:
        assert len(taken(until(lambda c: len(taken(c)) >= 5))) == 5
    stop.set()


def _pour(out: srt.Sender, data: bytes, seconds: float) -> None:
    """As fast as it is filmed."""
    size = 7 * 188
    for k in range(0, len(data), size):
        out.send_bytes(data[k : k + size])
        time.sleep(seconds * size / len(data))
    out.close()


@pytest.mark.parametrize(
    ("off_s", "basis"),
    [
        (0.0, "ntp"),
        pytest.param(-3.0, "ntp", marks=pytest.mark.slow),
        pytest.param(7200.0, "arrival", marks=pytest.mark.slow),
        pytest.param(None, "arrival", marks=pytest.mark.slow),
    ],
)
def test_a_cameras_clock_is_heard_over_rtcp_and_believed_if_it_can_be(
    off_s: float | None, basis: str
) -> None:
    with RtspCamera(encoded(10), 10.0, off_s) as camera:
        source = live_source(f"rtsp://127.0.0.1:{camera.port}/live")
        with read(source) as until:
            came = until(lambda c: len(taken(c)) >= 15)
            now_s = (time.time_ns() - source.start_ns) * 1e-9
            assert source.health.basis == basis
    late_s = now_s - came[-1].time_s
    assert late_s == pytest.approx(-(off_s or 0.0) if basis == "ntp" else 0.0, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("stalled_s", [10.0])
def test_a_stream_that_stalls_is_told_within_two_seconds_and_goes_on(stalled_s: float) -> None:
    port = free_port()
    source = live_source(f"udp://127.0.0.1:{port}")
    order = Order(f"udp://127.0.0.1:{port}?pkt_size=1316", seconds=None, stall=(3.0, stalled_s))
    sender = start(order)
    with read(source) as until:
        until(lambda c: len(taken(c)) >= 10)
        until(lambda c: source.health.silent_s > 0.5, 20.0)
        until(lambda c: source.health.state == "silent", 1.6)
        came = until(lambda c: source.health.state == "flows", 20.0)
        before = len(taken(came))
        came = until(lambda c: len(taken(c)) >= before + 10)
    sender.kill()
    gaps = [b.time_s - a.time_s for a, b in pairwise(taken(came))]
    # it is opened anew after five seconds, and waits for a picture that stands alone: one a second
    assert stalled_s - 0.5 < max(gaps) < stalled_s + 2.5
    assert sorted(gaps)[-2] < 0.5


@pytest.mark.slow
def test_a_server_that_dies_and_comes_back_is_called_again_with_longer_and_longer_pauses() -> None:
    pictures = encoded(10)
    with RtspCamera(pictures, 10.0) as camera:
        port = camera.port
        source = live_source(f"rtsp://127.0.0.1:{port}/live", reconnect=2.0)
        reading = read(source)
        until = reading.__enter__()
        until(lambda c: len(taken(c)) >= 5)
    until(lambda c: source.health.state == "silent")
    time.sleep(5.0)
    with RtspCamera(encoded(10, (320, 240)), 10.0, port=port):
        came = until(lambda c: source.health.state == "flows")
        before = len(taken(came))
        until(lambda c: len(taken(c)) >= before + 5)
        assert source.health.connections == 2
        reading.__exit__(None, None, None)

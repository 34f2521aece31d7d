"""Sends a live stream from a process of its own: a small made-up picture, or a recording as if it were filmed now.

``python -m tests.live_sender '{"url": "udp://127.0.0.1:5600", "format": "mpegts", ..}'``; the keys are those of Order.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
_TICKS = Fraction(1, 90_000)


@dataclass(frozen=True)
class Order:
    """url, format, options: FFmpeg's. seconds: then it ends; None: with the recording.

    size, rate_hz: of made-up pictures. track: a DJI subtitle file; KLV of it is sent beside the pictures, stamped with
    the time at which it is sent plus stamps_off_s. video: a recording, sent as it is; before that, until the file
    ``hold`` is there, its first picture, and the drone hovers. stall: after so many seconds nothing is sent for so
    long; the time goes on.
    """

    url: str
    format: str = "mpegts"
    options: dict[str, str] = field(default_factory=dict)
    seconds: float | None = 5.0
    size: tuple[int, int] = (160, 120)
    rate_hz: int = 10
    track: str | None = None
    klv_hz: float = 10.0
    stamps_off_s: float = 0.0
    video: str | None = None
    hold: str | None = None
    stall: tuple[float, float] | None = None
    first_pts_s: float = 1.4


def start(order: Order) -> subprocess.Popen[bytes]:
    """The sender's process; end it with kill."""
    command = [sys.executable, "-m", "tests.live_sender", json.dumps(asdict(order))]
    return subprocess.Popen(command, cwd=ROOT)


@dataclass(frozen=True)
class _Sent:
    """An encoded picture, Annex B. at_s: it is shown, since the stream's begin; sent_s: it is sent and decoded. way_s:
    of the drone's way.
    """

    data: bytes
    key: bool
    at_s: float
    way_s: float
    sent_s: float


def _encoded(
    images: Iterator[av.VideoFrame], size: tuple[int, int], rate_hz: int
) -> Iterator[tuple[bytes, bool]]:
    codec = av.CodecContext.create("libx264", "w")
    codec.width, codec.height, codec.pix_fmt = *size, "yuv420p"
    codec.framerate, codec.time_base = Fraction(rate_hz), Fraction(1, rate_hz)
    codec.options = {"preset": "ultrafast", "tune": "zerolatency", "g": str(rate_hz), "bf": "0"}
    for i, frame in enumerate(images):
        frame.pts, frame.time_base = i, Fraction(1, rate_hz)
        for packet in codec.encode(frame):
            yield bytes(packet), packet.is_keyframe


def _made_up(order: Order) -> Iterator[_Sent]:
    def images() -> Iterator[av.VideoFrame]:
        width, height = order.size
        across = np.arange(width)
        i = 0
        while True:
            image = np.broadcast_to(
                ((across + 5 * i) % 256).astype(np.uint8)[None, :, None], (height, width, 3)
            )
            yield av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
            i += 1

    for i, (data, key) in enumerate(_encoded(images(), order.size, order.rate_hz)):
        at_s = i / order.rate_hz
        if order.seconds is not None and at_s >= order.seconds:
            return
        yield _Sent(data, key, at_s, at_s, at_s)


def _recorded(order: Order) -> Iterator[_Sent]:
    """The first picture while it is held, then the recording."""
    assert order.video is not None
    at_s = 0.0
    with av.open(order.video) as container:
        first = next(container.decode(video=0))
        rate_hz = round(container.streams.video[0].average_rate or 30)
    size = first.width, first.height
    still = list(_encoded((first.reformat(format="yuv420p") for _ in range(rate_hz)), size, rate_hz))
    while order.hold is not None and not Path(order.hold).exists():
        for data, key in still:
            yield _Sent(data, key, at_s, 0.0, at_s)
            at_s += 1.0 / rate_hz
    with av.open(order.video) as container:
        stream = container.streams.video[0]
        at_s += 0.2  # decoding begins before the first picture is shown
        annex_b = av.BitStreamFilterContext("h264_mp4toannexb", stream)
        for packet in container.demux(stream):
            for whole in annex_b.filter(packet if packet.size else None):
                assert whole.pts is not None
                assert whole.dts is not None
                way_s, sent_s = (float(ticks * stream.time_base) for ticks in (whole.pts, whole.dts))
                yield _Sent(bytes(whole), whole.is_keyframe, at_s + way_s, way_s, at_s + sent_s)


def _klv(order: Order, way_s: float, stamp_s: float) -> bytes:
    """One packet: where the drone is at a time of its way, and a stamp."""
    from pipeline.ingest.telemetry.dji_srt import read_dji_srt
    from tests.dialects.klv import packets

    global _TRACK  # noqa: PLW0603
    if _TRACK is None:
        _TRACK = read_dji_srt(Path(str(order.track)))
    row = int(np.abs(_TRACK.times_s - way_s).argmin())
    columns = {
        name: value[row : row + 1]
        for name, value in ((n, getattr(_TRACK, n)) for n in _TRACK.__slots__)
        if isinstance(value, np.ndarray) and len(value) == len(_TRACK.times_s)
    }
    one = replace(_TRACK, **columns, start_time_ns=round(stamp_s * 1e9), end_s=None)
    return packets(one, ground_m=None)[0]


_TRACK = None


def send(order: Order) -> None:
    """Until it is over."""
    out = av.open(order.url, "w", format=order.format, options=order.options)
    sent = _made_up(order) if order.video is None else _recorded(order)
    with av.open(order.video) if order.video else _nothing() as recording:
        size = order.size
        if recording is not None:
            codec = recording.streams.video[0].codec_context
            size = codec.width, codec.height
    video = out.add_stream("libx264", rate=order.rate_hz)
    video.width, video.height, video.pix_fmt = *size, "yuv420p"
    data = out.add_data_stream("klv") if order.track is not None else None
    begun_s, klv_due_s, begun_utc_s = time.monotonic(), 0.0, time.time()
    for one in sent:
        wait_s = begun_s + one.sent_s - time.monotonic()
        if wait_s > 0.0:
            time.sleep(wait_s)
        if order.stall is not None and order.stall[0] <= one.at_s < sum(order.stall):
            continue
        ticks, sent = (round((order.first_pts_s + s) * 90_000) for s in (one.at_s, one.sent_s))
        if data is not None and one.sent_s >= klv_due_s - 1e-6:
            klv_due_s = max(klv_due_s + 1.0 / order.klv_hz, one.sent_s)
            way_s = max(0.0, one.way_s + one.sent_s - one.at_s)
            piece = av.Packet(_klv(order, way_s, begun_utc_s + one.sent_s + order.stamps_off_s))
            piece.stream, piece.time_base, piece.pts, piece.dts = data, _TICKS, sent, sent
            out.mux(piece)
        packet = av.Packet(one.data)
        packet.stream, packet.time_base, packet.pts, packet.dts = video, _TICKS, ticks, sent
        packet.is_keyframe = one.key
        out.mux(packet)
    out.close()


@contextmanager
def rtsp_server(video: Path, track: Path, user: str, password: str) -> Iterator[str]:
    """tstrans' server on loopback, which sends a recording's first picture with KLV; its address without the scheme."""
    from tstrans import mpegts, rtp

    auth = rtp.BasicAuth(user, password, realm="drone")
    server = rtp.RtspServer.start(rtp.RtspServerConfig(bind_addr="127.0.0.1:0", auth=auth))
    program = mpegts.MuxerProgramConfigBuilder(1, 0x100).add_video(0x101, mpegts.VideoCodec.H264)
    kind = mpegts.KlvStreamType.PRIVATE_DATA
    program = program.add_klv(0x102, kind, carries_pts=True).pcr_pid(0x101)
    mount, stop = server.add_unicast_mount("/live", program.build()), threading.Event()
    held = Order("", video=str(video), track=str(track), hold="/never")

    def push() -> None:
        begun_s, begun_utc_s, due_s = time.monotonic(), time.time(), 0.0
        for one in _recorded(held):
            if stop.wait(max(0.0, begun_s + one.sent_s - time.monotonic())):
                return
            pts = mpegts.Pts90khz(90_000 + round(one.at_s * 90_000))
            mount.push_video(one.data, pts=pts, key_frame=one.key)
            if one.sent_s >= due_s:
                due_s += 0.1
                mount.push_klv(_klv(held, 0.0, begun_utc_s + one.sent_s), pts=pts)

    threading.Thread(target=push, daemon=True).start()
    try:
        yield str(server.local_addr())
    finally:
        stop.set()
        server.cancel_handle().cancel()


class _nothing:  # noqa: N801
    def __enter__(self) -> None:
        return None

    def __exit__(self, *_: object) -> None:
        return None


if __name__ == "__main__":
    send(Order(**json.loads(sys.argv[1])))

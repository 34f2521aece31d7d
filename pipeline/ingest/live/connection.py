"""One connection to a live stream: opened within a time limit, read until it ends, breaks or is silent."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeAlias

import av
from av.container import InputContainer
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from pipeline.config.stream_url import StreamUrl
from pipeline.ingest.live.fault import LiveFaultError
from pipeline.ingest.live.srt import SrtBytes, open_srt
from pipeline.ingest.telemetry.misb_packets import KEY
from pipeline.ingest.video.container import video_tracks

#: 16K by 16K: a damaged head must not take all memory
_MAX_PIXELS = 16384 * 16384
#: a stream without a picture in so many packets is no video of ours
_MOST_PACKETS = 5000
#: FFmpeg looks at so much of a stream before it gives the first packet, microseconds and bytes
_ANALYSED = {"analyzeduration": "500000", "probesize": "1000000"}
_OPTIONS = {
    "rtsp": {"rtsp_transport": "tcp", "allowed_media_types": "video+data"},
    "udp": {"fifo_size": "50000", "overrun_nonfatal": "1", "buffer_size": "4194304"},
}
_TRANSPORTS = ("tcp", "udp")


Keep: TypeAlias = "Callable[[Packet[VideoStream], float], None]"


@dataclass(frozen=True)
class Shown:
    """A picture, or None for one that is damaged. shown_s: its presentation time. arrival_s: when it came.

    ntp_s: when it was taken, seconds since 1970 by the sender's clock; NaN where it does not say.
    """

    frame: VideoFrame | None
    shown_s: float
    arrival_s: float
    ntp_s: float = math.nan


@dataclass(frozen=True)
class KlvBytes:
    """A piece of metadata. shown_s: its presentation time, NaN without."""

    data: bytes
    shown_s: float
    arrival_s: float


class Connection:
    """An open stream. Make it with ``connect``; close it."""

    def __init__(
        self,
        container: InputContainer,
        stream: VideoStream,
        now_s: Callable[[], float],
        source: SrtBytes | None,
    ) -> None:
        self._container, self._stream, self._now_s, self._source = container, stream, now_s, source
        codec = stream.codec_context
        codec.thread_count = 1
        codec.options = {"err_detect": "explode", "max_pixels": str(_MAX_PIXELS)}

    @property
    def stream(self) -> VideoStream:
        """The track of the pictures."""
        return self._stream

    @property
    def codec(self) -> str:
        """FFmpeg's name."""
        return str(self._stream.codec_context.name)

    @property
    def rate_hz(self) -> float:
        """As the stream says; 0 if it does not."""
        rate = float(self._stream.guessed_rate or self._stream.average_rate or 0.0)
        return rate if 0.0 < rate <= 1000.0 else 0.0

    @property
    def aspect(self) -> Fraction | None:
        """Of a pixel."""
        return self._stream.sample_aspect_ratio

    @property
    def has_data(self) -> bool:
        """Whether there is a track beside the pictures that could hold KLV."""
        return any(s.type == "data" for s in self._container.streams)

    def items(self, keep: Keep | None = None) -> Iterator[Shown | KlvBytes]:
        """What comes, from the first picture that stands alone on. Raises LiveFaultError at the end, always.

        keep: is given each packet of a picture, before it is decoded, and when it came.
        """
        begun = False
        for packet in self._packets():
            arrival_s = self._now_s()
            if packet.stream.type == "data":
                data = bytes(packet)
                if KEY in data:
                    yield KlvBytes(data, _seconds(packet), arrival_s)
                continue
            if packet.stream.index != self._stream.index:
                continue
            begun = begun or packet.is_keyframe
            if begun and keep is not None:
                keep(packet, arrival_s)
            if begun:
                yield from self._decoded(packet, arrival_s)

    def _packets(self) -> Iterator[Packet[Any]]:
        try:
            for packet in self._container.demux():
                if packet.size:
                    yield packet
        except av.FFmpegError as error:
            raise self._fault(error) from None
        if self._source is not None and self._source.silent:
            raise LiveFaultError("nothing came any more")
        raise LiveFaultError("the sender ended it", ended=True)

    def _fault(self, error: av.FFmpegError) -> LiveFaultError:
        if isinstance(error, av.error.ExitError):
            return LiveFaultError("nothing came any more")
        # RTMP has no word for the end: a sender that goes closes its connection
        closed = isinstance(error, av.error.EOFError | BrokenPipeError | ConnectionResetError) or (
            error.strerror == "Input/output error"
        )
        return LiveFaultError("the sender ended it" if closed else _words(error), ended=closed)

    def _decoded(self, packet: Packet[VideoStream], arrival_s: float) -> Iterator[Shown]:
        ntp_s = _ntp_s(packet)
        try:
            frames = self._stream.codec_context.decode(packet)
        except (av.FFmpegError, ValueError):
            yield Shown(None, _seconds(packet), arrival_s)
            return
        for frame in frames:
            shown_s = _of(frame)
            at_s = ntp_s + shown_s - _seconds(packet) if math.isfinite(ntp_s) else math.nan
            yield Shown(None if frame.is_corrupt else frame, shown_s, arrival_s, at_s)

    def close(self) -> None:
        """Let it go."""
        with suppress(av.FFmpegError, OSError):
            self._container.close()
        if self._source is not None:
            self._source.close()


def connect(url: StreamUrl, open_s: float, read_s: float, now_s: Callable[[], float]) -> Connection:
    """Open a stream. open_s: so long that may take; read_s: a silence of so long ends it. now_s: for arrivals.

    Raises LiveFaultError with the reason.
    """
    source = open_srt(url, open_s, read_s) if url.scheme == "srt" else None
    try:
        container = _container(url, open_s, read_s, source)
    except av.FFmpegError as error:
        if source is not None:
            source.close()
        raise _not_opened(url, error, open_s) from None
    except (OSError, ValueError) as error:
        if source is not None:
            source.close()
        raise LiveFaultError(f"it cannot be opened ({type(error).__name__})") from None
    tracks = [s for s in video_tracks(container) if s.codec_context is not None]
    if not tracks:
        container.close()
        if source is not None:
            source.close()
        raise LiveFaultError("something came, but no video", for_good=True)
    stream = max(tracks, key=lambda s: s.codec_context.width * s.codec_context.height)
    return Connection(container, stream, now_s, source)


def _container(url: StreamUrl, open_s: float, read_s: float, source: SrtBytes | None) -> InputContainer:
    options = dict(_ANALYSED)
    if source is not None:
        return av.open(source, "r", format="mpegts", options=options, metadata_errors="replace")
    options |= _OPTIONS.get(url.scheme, {})
    query, text = url.query, url.text
    if url.scheme == "rtmp" and query.get("listen") == "1":
        options["listen"], text = "1", url.without_query()
    if url.scheme == "rtsp" and query.get("transport") in _TRANSPORTS:
        options["rtsp_transport"], text = query["transport"], url.without_query()
    if url.scheme == "udp" and not _is_multicast(url.host):
        options["localaddr"] = url.host or "0.0.0.0"  # else FFmpeg binds every address
    form = "mpegts" if url.scheme == "udp" else None
    limits = (open_s, read_s)
    return av.open(text, "r", format=form, options=options, timeout=limits, metadata_errors="replace")


def _is_multicast(host: str) -> bool:
    first = host.partition(".")[0]
    return host.lower().startswith("ff") or (first.isdigit() and 224 <= int(first) <= 239)


def _not_opened(url: StreamUrl, error: av.FFmpegError, open_s: float) -> LiveFaultError:
    if isinstance(error, av.error.HTTPUnauthorizedError | av.error.HTTPForbiddenError):
        said = "the password that was given is refused" if url.has_password else "it wants a password"
        return LiveFaultError(f"{said} ({error.strerror})", for_good=True)
    if isinstance(error, av.error.HTTPNotFoundError):
        return LiveFaultError("the server knows no stream of this name", for_good=True)
    if isinstance(error, av.error.ExitError):
        return LiveFaultError(f"nothing came within {open_s:g} s")
    if isinstance(error, av.error.InvalidDataError):
        return LiveFaultError("something came, but no video")
    return LiveFaultError(_words(error))


def _words(error: av.FFmpegError) -> str:
    """FFmpeg's reason; its whole message would show the address."""
    words = str(error.strerror or type(error).__name__)
    return words[:1].lower() + words[1:]


def _seconds(packet: Packet[Any]) -> float:
    if packet.pts is None or packet.time_base is None:
        return math.nan
    return float(packet.pts * packet.time_base)


def _of(frame: VideoFrame) -> float:
    return math.nan if frame.pts is None or frame.time_base is None else float(frame.pts * frame.time_base)


def _ntp_s(packet: Packet[Any]) -> float:
    """When a packet's picture was taken by RTCP's sender reports, which FFmpeg hands on (``prft``)."""
    if not packet.has_sidedata("prft"):
        return math.nan
    data = bytes(packet.get_sidedata("prft"))
    return struct.unpack_from("<q", data)[0] * 1e-6 if len(data) >= 8 else math.nan

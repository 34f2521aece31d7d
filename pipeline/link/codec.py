"""Encode and decode the frames of a substream.

One packet per picture, without delay, in one thread, the same bytes every time.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, cast

import av
import numpy as np
from av.codec.context import Flags
from av.video.codeccontext import VideoCodecContext
from av.video.frame import PictureType, VideoFrame
from numpy.typing import NDArray

from pipeline.errors import InputError

# SVT-AV1 prints its settings to stderr unless silenced; its errors reach us through FFmpeg
os.environ.setdefault("SVT_LOG", "0")

Codec = Literal["h264", "h265", "vp9", "av1"]
_ENCODERS = {"h264": "libx264", "h265": "libx265", "vp9": "libvpx-vp9", "av1": "libsvtav1"}
_DECODERS = {"h264": "h264", "h265": "hevc", "vp9": "vp9", "av1": "libdav1d"}
_BUFFER_S = 0.5  # how much link time the encoder may borrow; a keyframe takes most of it


@dataclass(frozen=True, slots=True)
class Encoded:
    """The packet of one picture. pts: as given to the encoder, in units of its time base."""

    data: bytes
    keyframe: bool
    pts: int


def available_codecs() -> tuple[Codec, ...]:
    """The codecs that this build of FFmpeg can both encode and decode."""
    return tuple(
        cast(Codec, name) for name in _ENCODERS if _has(_ENCODERS[name], "w") and _has(_DECODERS[name], "r")
    )


def require_codec(codec: str) -> None:
    """Raises InputError if this build of FFmpeg lacks the codec."""
    if codec not in available_codecs():
        have = ", ".join(available_codecs())
        raise InputError("processing.codec", f"{codec}, which this build of FFmpeg lacks", f"one of {have}")


class Encoder:
    """One pass, target bitrate, no look-ahead, no B-frames; equal input gives equal bytes.

    width, height: even, pixels. frame_rate_hz: of the substream. bitrate_bps: mean of the substream; h264 and
    h265 overdraw it by at most half a second of it (or two pictures). keyframe_interval: pictures.
    Raises InputError if the codec is missing, the size odd, or the bitrate not a positive number.
    """

    def __init__(
        self,
        codec: Codec,
        width: int,
        height: int,
        frame_rate_hz: float,
        bitrate_bps: float,
        keyframe_interval: int,
    ) -> None:
        require_codec(codec)
        if width % 2 or height % 2:
            raise InputError("video", f"{width} x {height} pixels", "an even width and height to encode it")
        if not 0.0 < bitrate_bps < math.inf:
            raise InputError("processing.bitrates", f"{bitrate_bps:g} bit/s", "a positive, finite bitrate")
        rate = Fraction(frame_rate_hz).limit_denominator(100_000)
        context = cast(VideoCodecContext, av.CodecContext.create(_ENCODERS[codec], "w"))
        context.width, context.height, context.pix_fmt = width, height, "yuv420p"
        context.framerate, context.time_base = rate, 1 / rate
        context.gop_size = keyframe_interval
        context.thread_count = 1
        context.options = _options(codec, float(rate), bitrate_bps)
        self.time_base: Fraction = 1 / rate
        self._context = context

    def encode(self, image: NDArray[np.uint8], pts: int, keyframe: bool = False) -> Encoded:
        """The one packet of a picture.

        image: uint8 (H, W, 3) RGB. pts: units of time_base, greater than the last. keyframe: force one.
        """
        return self.encode_frame(VideoFrame.from_ndarray(image, format="rgb24"), pts, keyframe)

    def encode_frame(self, frame: VideoFrame, pts: int, keyframe: bool = False) -> Encoded:
        """As encode, of FFmpeg's own frame, which is changed; in yuv420p nothing has to be converted.

        The colour matrix of the first frame is written into the stream, so that the decoder makes the same RGB.
        """
        if not self._context.is_open:
            self._context.colorspace, self._context.color_range = frame.colorspace, frame.color_range
        frame.pts, frame.time_base = pts, self.time_base
        frame.pict_type = PictureType.I if keyframe else PictureType.NONE
        (packet,) = self._context.encode(frame)
        return Encoded(bytes(packet), packet.is_keyframe, pts)


class Decoder:
    """The other end of an Encoder: packets in the order of encoding, the first one a keyframe."""

    def __init__(self, codec: Codec) -> None:
        require_codec(codec)
        context = cast(VideoCodecContext, av.CodecContext.create(_DECODERS[codec], "r"))
        context.thread_count = 1
        context.flags |= Flags.low_delay.value
        context.options = {"err_detect": "crccheck+bitstream+buffer"}
        self._context = context

    def decode(self, data: bytes) -> NDArray[np.uint8]:
        """The one picture of a packet, uint8 (H, W, 3) RGB.

        Raises ValueError if no whole picture can be made of the packet; decoding can go on with the next
        keyframe. Damage that leaves the syntax whole goes unnoticed, and so does, for h264 and av1, a missing
        packet: after a packet is lost, ask the encoder for a keyframe.
        """
        return cast("NDArray[np.uint8]", self.decode_frame(data).to_ndarray(format="rgb24"))

    def decode_frame(self, data: bytes) -> VideoFrame:
        """As decode, to FFmpeg's own frame, whose pixels are not converted."""
        if not data:  # FFmpeg would take it for the end of the stream
            raise ValueError("an empty packet")
        try:
            frames = self._context.decode(av.Packet(data))
        except av.FFmpegError as error:
            raise ValueError(f"a packet of {len(data)} bytes cannot be decoded: {error.strerror}") from None
        if len(frames) != 1 or frames[0].is_corrupt:
            raise ValueError(f"a packet of {len(data)} bytes does not hold one whole picture")
        return frames[0]


def _has(name: str, mode: Literal["r", "w"]) -> bool:
    try:
        av.Codec(name, mode)
    except av.codec.codec.UnknownCodecError:
        return False
    return True


def _options(codec: Codec, rate_hz: float, bitrate_bps: float) -> dict[str, str]:
    bitrate = str(round(bitrate_bps))
    buffer_s = max(_BUFFER_S, 2.0 / rate_hz)
    capped = {"b": bitrate, "maxrate": bitrate, "bufsize": str(round(bitrate_bps * buffer_s))}
    low_delay = {"preset": "ultrafast", "tune": "zerolatency", "forced-idr": "1"}
    if codec == "h264":
        return capped | low_delay
    if codec == "h265":
        threads = "pools=none:frame-threads=1:wpp=0"
        return capped | low_delay | {"x265-params": f"log-level=none:info=0:{threads}"}
    if codec == "vp9":
        keyframe_percent = math.ceil(100 * max(1.0, 0.5 * buffer_s * rate_hz))
        return capped | {
            "minrate": bitrate,
            "deadline": "realtime",
            "cpu-used": "8",
            "lag-in-frames": "0",
            "max-intra-rate": str(keyframe_percent),
        }
    # pred-struct 1: low delay; rc 2: constant bitrate; lp 1: one thread
    return {"b": bitrate, "preset": "12", "svtav1-params": "pred-struct=1:rc=2:lp=1"}

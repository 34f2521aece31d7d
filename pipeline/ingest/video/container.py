"""Open a video file and choose its track; packets on one clock."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import av
from av.container import InputContainer
from av.packet import Packet
from av.stream import Disposition
from av.video.stream import VideoStream

from pipeline.errors import InputError

# Only containers of recordings: FFmpeg would also take a playlist, and fetch what it names.
_OPTIONS = {"format_whitelist": "mov,matroska,webm,avi,mpegts", "protocol_whitelist": "file"}
EXPECTED = "a whole MP4, MOV, MKV, AVI or TS video"
#: 16K by 16K: a damaged header must not take all memory
_MAX_PIXELS = 16384 * 16384
#: a clock that goes back by more than pictures change their order in a file begins anew, seconds
_RESTART_S = 1.0
#: nor is it a gap of so many seconds: FFmpeg takes a clock that begins anew for one that wrapped after 26 hours
LONGEST_GAP_S = 13 * 3600.0
#: a file in which nothing can be read so many times in a row is at its end
_MAX_FAULTS = 20


@contextmanager
def opened(path: Path, threads: int = 1) -> Iterator[tuple[InputContainer, VideoStream]]:
    """The file and its video track, to be decoded by so many threads.

    Raises InputError for a file that is missing, empty, no video, or of a codec that is not known.
    """
    if not path.is_file():
        raise InputError(path, "no file", EXPECTED)
    if path.stat().st_size == 0:
        raise InputError(path, "an empty file", EXPECTED)
    try:
        # titles are in whatever a camera wrote; nobody reads them here
        container = av.open(str(path), options=_OPTIONS, metadata_errors="replace")
    except (av.FFmpegError, OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(path, f"a file that cannot be opened ({reason})", EXPECTED) from None
    with container:
        tracks = video_tracks(container)
        if not tracks:
            raise InputError(path, "no video in the file", EXPECTED)
        stream = max(tracks, key=_area)
        codec = stream.codec_context
        if codec is None:
            raise InputError(path, "a video codec that is not known", "H.264, H.265, VP9, AV1 or MPEG-4")
        codec.thread_count = threads
        if threads > 1:
            codec.thread_type = "AUTO"
        # explode: a picture with an error in it is lost, not shown with what the decoder made up
        codec.options = {"err_detect": "explode", "max_pixels": str(_MAX_PIXELS)}
        try:
            yield container, stream
        except av.FFmpegError as error:
            raise InputError(path, f"a file that cannot be read ({error.strerror})", EXPECTED) from None


def video_tracks(container: InputContainer) -> list[VideoStream]:
    """The tracks that could be meant: of several the one of the largest pictures is used; no cover pictures."""
    return [s for s in container.streams.video if not s.disposition & Disposition.attached_pic]


def _area(stream: VideoStream) -> int:
    codec = stream.codec_context
    return 0 if codec is None else codec.width * codec.height


#: containers in which a time leads nowhere: its clock may begin anew, or it has none
NOT_SOUGHT = ("mpegts", "avi")


def is_counted(container: InputContainer) -> bool:
    """Whether pictures have a number only, not a time: AVI, whose rate is constant."""
    return container.format.name == "avi"


def timed_packets(
    container: InputContainer, stream: VideoStream
) -> Iterator[tuple[Packet[VideoStream], int]]:
    """Packets with a picture, in decoding order, and their presentation time in units of stream.time_base.

    Times go on where the clock of the file begins anew (a TS whose counter wraps or whose writer restarted): the
    first one after that follows the last one before. Where nothing can be read any more, the packets end.
    """
    last_dts, offset, step, latest = None, 0, 1, 0
    restart, leap = (
        round(s / stream.time_base) if stream.time_base else 1 for s in (_RESTART_S, LONGEST_GAP_S)
    )
    for packet in _readable(container, stream):
        dts = packet.dts if packet.dts is not None else packet.pts
        dts = dts if dts is not None else (last_dts or 0) + step - offset
        if last_dts is not None and not -restart <= dts + offset - last_dts <= leap:
            offset = latest + step - (packet.pts if packet.pts is not None else dts)
        if last_dts is not None and 0 < dts + offset - last_dts < restart:
            step = dts + offset - last_dts
        last_dts = dts + offset
        ticks = (packet.pts if packet.pts is not None and not is_counted(container) else dts) + offset
        latest = max(latest, ticks)
        yield packet, ticks


def _readable(container: InputContainer, stream: VideoStream) -> Iterator[Packet[VideoStream]]:
    faults = 0
    while faults < _MAX_FAULTS:
        try:
            for packet in container.demux(stream):
                if packet.size:
                    faults = 0
                    yield packet
            return
        except (av.FFmpegError, ValueError):
            faults += 1

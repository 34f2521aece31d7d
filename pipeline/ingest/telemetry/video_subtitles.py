"""DJI's subtitles as the text track of the video itself, and what to do about tracks that only DJI reads.

MP4 and MOV carry them as timed text (3GPP TS 26.245, ``mov_text``: two bytes of length, then the text), Matroska
as SubRip. A cue is a packet; its time counts from the video's first picture, edit lists honoured.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import av
from av.container import InputContainer
from av.stream import Discard, Stream

from pipeline.errors import InputError
from pipeline.ingest.telemetry.dji_position import GpsOrder
from pipeline.ingest.telemetry.dji_srt import track_of_cues
from pipeline.ingest.telemetry.subtitles import Cue, without_tags
from pipeline.ingest.text import decoded
from pipeline.ingest.track import Track

#: only containers of recordings: FFmpeg would also take a playlist, and fetch what it names
_OPTIONS = {"format_whitelist": "mov,matroska,webm,avi,mpegts", "protocol_whitelist": "file"}
_TEXT_CODECS = frozenset({"mov_text", "subrip", "srt", "text"})
_MP4_BOXES = frozenset({b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide"})
_MATROSKA, _SYNC, _TS_PACKET = b"\x1a\x45\xdf\xa3", 0x47, 188
#: handler names of DJI's own data tracks, ``djmd`` and ``dbgi``
_DJI_DATA = ("dji meta", "djmd", "dji dbgi", "dbgi")
EXPECTED = "a video with DJI's subtitles as a text track"


def is_video(head: bytes) -> bool:
    """Whether a file begins as MP4, MOV, Matroska, AVI or MPEG-TS."""
    transport = len(head) > _TS_PACKET and head[0] == head[_TS_PACKET] == _SYNC
    avi = head[:4] == b"RIFF" and head[8:12] == b"AVI "
    return head[4:8] in _MP4_BOXES or head.startswith(_MATROSKA) or transport or avi


def is_video_with_subtitles(path: Path, head: bytes) -> bool:
    """Whether a file is a video with a track of text."""
    if not is_video(head):
        return False
    try:
        with av.open(str(path), options=_OPTIONS) as container:
            return _text_track(container) is not None
    except (av.FFmpegError, OSError):
        return False


def read_video_subtitles(path: Path, order: GpsOrder | None = None) -> Track:
    """The samples in the first text track of a video; ``order`` as in ``read_dji_srt``.

    Raises InputError if there is no such track, or nothing in it that can be used.
    """
    try:
        with av.open(str(path), options=_OPTIONS) as container:
            track = _text_track(container)
            if track is None:
                raise without_telemetry(path)
            cues = list(_cues(path, container, track))
    except (av.FFmpegError, OSError) as error:
        raise InputError(path, f"a file that cannot be read ({error.strerror})", EXPECTED) from None
    if not cues:
        raise InputError(path, "a text track without a cue", EXPECTED)
    return track_of_cues(path, cues, order)


def without_telemetry(path: Path) -> InputError:
    """The error for a video that was named as telemetry and holds none that can be read; it says what to do."""
    found = "a video without a telemetry track"
    try:
        with av.open(str(path), options=_OPTIONS) as container:
            handlers = [s.metadata.get("handler_name", "").strip().lower() for s in container.streams]
        if any(handler.startswith(_DJI_DATA) for handler in handlers):
            found = "a video whose telemetry is in DJI's own data track (djmd), which is not read here"
    except (av.FFmpegError, OSError):
        found = "a video that cannot be opened"
    expected = (
        "telemetry.file: the drone's SRT beside the video (DJI Fly: camera settings, Video Subtitles), or the flight "
        "log as CSV (Airdata, Litchi), or a table of what exiftool -ee finds in it (telemetry.columns)"
    )
    return InputError(path, found, expected)


def _text_track(container: InputContainer) -> Stream | None:
    return next((s for s in container.streams.subtitles if s.codec_context.name in _TEXT_CODECS), None)


def _cues(path: Path, container: InputContainer, track: Stream) -> Iterator[Cue]:
    """The cues; empty packets fill the time between two of them and are none."""
    video = container.streams.best("video")
    first_s = _seconds(video.start_time, video) if video is not None else 0.0
    for other in container.streams:
        # the pictures of an hour are gigabytes
        other.discard = Discard.default if other is track else Discard.all
    is_timed_text = track.codec_context.name == "mov_text"
    number = 0
    for packet in container.demux(track):
        data = bytes(packet)
        text = without_tags(_text(data) if is_timed_text else decoded(data)).strip()
        if not text:
            continue
        number += 1
        begin_s = math.nan if packet.pts is None else _seconds(packet.pts, track) - first_s
        end_s = begin_s + _seconds(packet.duration, track) if packet.duration else None
        yield Cue(f"{path} text track, cue {number}", begin_s, end_s, text)


def _text(data: bytes) -> str:
    """Of a sample of timed text: its length, the text, then boxes of style that say nothing here."""
    return decoded(data[2 : 2 + int.from_bytes(data[:2], "big")])


def _seconds(ticks: int | None, stream: Stream) -> float:
    return 0.0 if ticks is None or stream.time_base is None else float(ticks * stream.time_base)

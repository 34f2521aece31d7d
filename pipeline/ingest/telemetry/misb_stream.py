"""KLV inside an MPEG transport stream: its pieces, and the time of the video at which each is shown."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path

import av
from av.container import InputContainer
from av.stream import Stream

from pipeline.errors import InputError
from pipeline.ingest.samples import LeftOut
from pipeline.ingest.telemetry.misb_packets import KEY

_SYNC = 0x47
#: lengths of a transport packet: plain, with a time code before it (M2TS), with error correction behind it
_STRIDES = ((188, 0), (192, 4), (204, 0))
_OPTIONS = {"format_whitelist": "mpegts", "protocol_whitelist": "file"}
_EXPECTED = "an MPEG transport stream with a KLV track"


@dataclass(frozen=True, slots=True)
class KlvPiece:
    """time_s: since the video's first picture; NaN without a presentation time. video_s: how far the video was."""

    data: bytes
    time_s: float
    video_s: float


def is_transport_stream(head: bytes) -> bool:
    """Whether bytes begin with packets of a transport stream."""
    return any(
        len(head) > offset + 2 * length
        and all(head[offset + k * length] == _SYNC for k in range(min(4, (len(head) - offset - 1) // length)))
        for length, offset in _STRIDES
    )


def klv_pieces(path: Path, left_out: LeftOut) -> list[KlvPiece]:
    """The pieces (PES packets) of the first data track that holds ST 0601. Raises InputError if there is none.

    A stream that cannot be read on is counted as ``damaged``: what was read before it counts.
    """
    try:
        with av.open(str(path), options=_OPTIONS) as container:
            video = container.streams.best("video")
            tracks = [stream for stream in container.streams if stream.type == "data"]
            if not tracks:
                raise InputError(path, "a transport stream without a data track", _EXPECTED)
            wanted = [*tracks] if video is None else [video, *tracks]
            return _chosen(path, container, video, wanted, left_out)
    except (av.FFmpegError, OSError) as error:
        raise InputError(path, f"a file that cannot be read ({error.strerror})", _EXPECTED) from None


def _chosen(
    path: Path,
    container: InputContainer,
    video: Stream | None,
    wanted: list[Stream],
    left_out: LeftOut,
) -> list[KlvPiece]:
    shown: list[tuple[int, float]] = []  # place in the file and time of each picture
    pieces: dict[int, list[tuple[int, KlvPiece]]] = {}
    first_s = math.inf
    try:
        for packet in container.demux(*wanted):
            if not packet.size or packet.time_base is None:
                continue
            time_s = math.nan if packet.pts is None else float(packet.pts * packet.time_base)
            place = packet.pos or 0
            if video is None or packet.stream.index != video.index:
                piece = KlvPiece(bytes(packet), time_s, math.nan)
                pieces.setdefault(packet.stream.index, []).append((place, piece))
            elif not math.isnan(time_s):
                first_s = min(first_s, time_s)
                decoded_s = time_s if packet.dts is None else float(packet.dts * packet.time_base)
                shown.append((place, decoded_s))
    except (av.FFmpegError, IndexError):  # PyAV has no place for a track that only damage announced
        left_out.add("damaged", f"{path} after {len(shown)} pictures")
    with_key = [number for number, own in pieces.items() if any(KEY in piece.data for _, piece in own)]
    if not with_key:
        raise InputError(path, "a transport stream without MISB ST 0601 metadata", _EXPECTED)
    start_s = first_s if math.isfinite(first_s) else 0.0
    shown.sort()
    return [
        KlvPiece(piece.data, piece.time_s - start_s, _before(shown, place) - start_s)
        for place, piece in pieces[min(with_key)]
    ]


def _before(shown: list[tuple[int, float]], place: int) -> float:
    """The time of the last picture that stands before a place in the file; the demuxer gives them in another order."""
    index = bisect_right(shown, (place, math.inf)) - 1
    return shown[index][1] if index >= 0 else math.nan

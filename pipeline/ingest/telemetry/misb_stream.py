"""KLV inside an MPEG transport stream: its pieces, and the time of the video at which each is shown."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import av

from pipeline.errors import InputError
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


def klv_pieces(path: Path) -> list[KlvPiece]:
    """The pieces (PES packets) of the first data track that holds ST 0601. Raises InputError if there is none."""
    try:
        with av.open(str(path), options=_OPTIONS) as container:
            video = container.streams.best("video")
            tracks = [stream for stream in container.streams if stream.type == "data"]
            if not tracks:
                raise InputError(path, "a transport stream without a data track", _EXPECTED)
            wanted = [*tracks] if video is None else [video, *tracks]
            return _chosen(path, container, video, wanted)
    except (av.FFmpegError, OSError) as error:
        raise InputError(path, f"a file that cannot be read ({error.strerror})", _EXPECTED) from None


def _chosen(
    path: Path,
    container: av.container.InputContainer,
    video: av.stream.Stream | None,
    wanted: list[av.stream.Stream],
) -> list[KlvPiece]:
    pieces: dict[int, list[KlvPiece]] = {}
    first_s, video_s, has_key = math.inf, math.nan, set()
    try:
        for packet in container.demux(*wanted):
            time_s = math.nan if packet.pts is None else float(packet.pts * packet.time_base)
            if video is not None and packet.stream.index == video.index:
                if packet.size and not math.isnan(time_s):
                    first_s = min(first_s, time_s)
                    decoded_s = float(packet.dts * packet.time_base) if packet.dts is not None else time_s
                    video_s = decoded_s
            elif packet.size:
                data = bytes(packet)
                pieces.setdefault(packet.stream.index, []).append(KlvPiece(data, time_s, video_s))
                if KEY in data:
                    has_key.add(packet.stream.index)
    except av.FFmpegError:
        pass  # a damaged end: what was read before it counts
    if not has_key:
        raise InputError(path, "a transport stream without MISB ST 0601 metadata", _EXPECTED)
    start_s = first_s if math.isfinite(first_s) else 0.0
    return [
        KlvPiece(piece.data, piece.time_s - start_s, piece.video_s - start_s)
        for piece in pieces[min(has_key)]
    ]

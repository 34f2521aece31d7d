"""A video again, with a track as timed text (MP4) or SubRip (Matroska) beside its pictures."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av

from pipeline.ingest.track import Track
from tests.dialects.dji_subtitles import Text, cues_of

#: FFmpeg opens its encoder of text only with the head of a script
_HEAD = (
    b"[Script Info]\nScriptType: v4.00+\n\n[V4+ Styles]\nFormat: Name, Fontname, Fontsize\nStyle: Default,Arial,16\n\n"
    b"[Events]\nFormat: Layer, Start, End, Style, Name, MarginL, MarginR, MarginV, Effect, Text\n"
)
_MILLISECOND = Fraction(1, 1000)


def write(path: Path, video: Path, rows: Track, text: Text) -> None:
    """The pictures are copied as they are; the suffix of path tells the container."""
    codec = "mov_text" if path.suffix.lower() in (".mp4", ".mov") else "srt"
    with av.open(str(video)) as source, av.open(str(path), "w") as container:
        pictures = source.streams.video[0]
        copied = container.add_stream_from_template(pictures)
        track = container.add_stream(codec)
        track.codec_context.subtitle_header = _HEAD
        for picture in source.demux(pictures):
            if picture.dts is not None:
                picture.stream = copied
                container.mux(picture)
        for begin_s, end_s, words in cues_of(rows, text):
            data = words.encode()
            packet = av.Packet(len(data).to_bytes(2, "big") + data if codec == "mov_text" else data)
            packet.stream, packet.time_base = track, _MILLISECOND
            packet.pts = packet.dts = round(begin_s * 1000)
            packet.duration = round(end_s * 1000) - packet.pts
            container.mux(packet)


def as_dji_data_track(path: Path) -> None:
    """Turn the text track of an MP4 into one that only DJI can read."""
    data = path.read_bytes()
    for old, new in (
        (b"tx3g", b"djmd"),
        (b"sbtl", b"meta"),
        (b"SubtitleHandler", b"DJI meta".ljust(15, b"\0")),
    ):
        data = data.replace(old, new)
    path.write_bytes(data)

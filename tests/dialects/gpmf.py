"""A track as GoPro's GPMF: payloads of a second, bare."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from pipeline.ingest.track import Track


def item(key: str, kind: str, size: int, count: int, data: bytes) -> bytes:
    return (
        key.encode() + struct.pack(">cBH", kind.encode("latin-1"), size, count) + data + bytes(-len(data) % 4)
    )


def nest(key: str, *contents: bytes) -> bytes:
    data = b"".join(contents)
    return item(key, "\0", 1, len(data), data)


def gps5(
    rows: Sequence[tuple[float, float, float]], when: datetime, fix: int = 3, datum: str = "MSLV"
) -> bytes:
    scale = (10_000_000, 10_000_000, 1000, 1000, 100)
    values = b"".join(
        struct.pack(">5l", round(lat * scale[0]), round(lon * scale[1]), round(alt * scale[2]), 500, 50)
        for lat, lon, alt in rows
    )
    stamp = when.strftime("%y%m%d%H%M%S.%f")[:16].encode()
    return nest(
        "STRM",
        item("STNM", "c", 1, 4, b"GPS5"),
        item("GPSF", "L", 4, 1, struct.pack(">L", fix)),
        item("GPSU", "U", 16, 1, stamp),
        item("GPSP", "S", 2, 1, struct.pack(">H", 150)),
        item("GPSA", "F", 4, 1, datum.encode()),
        item("SCAL", "l", 4, 5, struct.pack(">5l", *scale)),
        item("GPS5", "l", 20, len(rows), values),
    )


def gps9(rows: Sequence[tuple[float, float, float]], when: datetime, fix: int = 3) -> bytes:
    scale = (10_000_000, 10_000_000, 1000, 1000, 100, 1, 1000, 100, 1)
    since = when - datetime(2000, 1, 1, tzinfo=UTC)
    values = b"".join(
        struct.pack(
            ">7lHH", round(lat * scale[0]), round(lon * scale[1]), round(alt * scale[2]), 500, 50, since.days,
            round((since.seconds + since.microseconds * 1e-6 + k / len(rows)) * 1000), 150, fix,
        )
        for k, (lat, lon, alt) in enumerate(rows)
    )  # fmt: skip
    return nest(
        "STRM",
        item("STNM", "c", 1, 4, b"GPS9"),
        item("TYPE", "c", 1, 9, b"lllllllSS"),
        item("SCAL", "l", 4, 9, struct.pack(">9l", *scale)),
        item("GPS9", "?", 32, len(rows), values),
    )


def payload(*streams: bytes, name: bytes = b"Hero11 Black") -> bytes:
    return nest("DEVC", item("DVID", "L", 4, 1, b"\0\0\0\1"), item("DVNM", "c", 1, len(name), name), *streams)


def positions(track: Track, second: int, rate: int) -> list[tuple[float, float, float]]:
    part = range(second * rate, (second + 1) * rate)
    return [
        (float(track.latitude_deg[i]), float(track.longitude_deg[i]), float(track.absolute_height_m[i]))
        for i in part
    ]


def write(path: Path, track: Track, kind: str = "GPS5", rate: int = 10) -> None:
    """Whole seconds of a track of ``rate`` rows a second; an accelerometer's stream stands before the GPS."""
    data = b""
    for second in range(len(track.times_s) // rate):
        when = datetime.fromtimestamp(track.start_time_ns * 1e-9 + second, UTC)
        rows = positions(track, second, rate)
        stream = gps5(rows, when) if kind == "GPS5" else gps9(rows, when)
        other = nest("STRM", item("SCAL", "s", 2, 1, b"\1\xa2"), item("ACCL", "s", 6, 2, bytes(12)))
        data += payload(other, stream)
    path.write_bytes(data)


def write_video(path: Path, payloads: Sequence[bytes], first_s: float = 0.0) -> None:
    """An MP4 of a small video with the payloads, a second each, in a track as GoPro calls it."""
    from fractions import Fraction

    import av
    import numpy as np

    with av.open(str(path), "w", format="mp4") as out:
        video = out.add_stream("mpeg4", rate=10)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        data = out.add_data_stream("bin_data")
        data.metadata["handler_name"] = "GoPro MET"
        for i in range(10 * len(payloads)):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 4 * i % 256, np.uint8), format="rgb24")
            frame.pts, frame.time_base = i, Fraction(1, 10)
            for packet in video.encode(frame):
                out.mux(packet)
            if i % 10 == 0:
                own = av.Packet(payloads[i // 10])
                own.stream, own.time_base = data, Fraction(1, 1000)
                own.pts = own.dts = 100 * i + round(first_s * 1000)
                own.duration = 1000
                out.mux(own)
        for packet in video.encode(None):
            out.mux(packet)

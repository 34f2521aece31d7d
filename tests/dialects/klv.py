"""A track as MISB ST 0601 packets, bare or in a transport stream; written from the standard's tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

from pipeline.ingest.track import Track
from tests.dialects.attitudes import aircraft_of, relative_angles

KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
#: tag -> bytes, signed, least, greatest of the linear mapping
MAPPED = {
    5: (2, False, 0.0, 360.0), 6: (2, True, -20.0, 20.0), 7: (2, True, -50.0, 50.0),
    13: (4, True, -90.0, 90.0), 14: (4, True, -180.0, 180.0), 15: (2, False, -900.0, 19000.0),
    16: (2, False, 0.0, 180.0), 17: (2, False, 0.0, 180.0),
    18: (4, False, 0.0, 360.0), 19: (4, True, -180.0, 180.0), 20: (4, False, 0.0, 360.0),
    23: (4, True, -90.0, 90.0), 24: (4, True, -180.0, 180.0), 25: (2, False, -900.0, 19000.0),
    75: (2, False, -900.0, 19000.0), 90: (4, True, -90.0, 90.0), 91: (4, True, -90.0, 90.0),
}  # fmt: skip


def mapped(tag: int, value: float) -> bytes:
    size, signed, least, greatest = MAPPED[tag]
    steps = 2 ** (8 * size) - (2 if signed else 1)
    raw = (
        round(value * steps / (greatest - least))
        if signed
        else round((value - least) * steps / (greatest - least))
    )
    return raw.to_bytes(size, "big", signed=signed)


def ber_length(length: int, long_form: bool = False) -> bytes:
    if length < 128 and not long_form:
        return bytes([length])
    size = (length.bit_length() + 7) // 8 or 1
    return bytes([0x80 | size]) + length.to_bytes(size, "big")


def ber_oid(tag: int) -> bytes:
    digits = [tag & 0x7F]
    while tag := tag >> 7:
        digits.append(0x80 | (tag & 0x7F))
    return bytes(reversed(digits))


def packet(stamp_us: int, values: Mapping[int, float], extra: bytes = b"", long_form: bool = False) -> bytes:
    """One packet with its checksum. extra: whole items (tag, length, value) to be ignored."""
    body = b"\x02\x08" + stamp_us.to_bytes(8, "big")
    for tag, value in values.items():
        data = mapped(tag, value)
        body += ber_oid(tag) + ber_length(len(data)) + data
    body += extra + b"\x41\x01\x0d" + b"\x01\x02"
    whole = KEY + ber_length(len(body) + 2, long_form) + body
    total = sum(byte << (8 * (1 - i % 2)) for i, byte in enumerate(whole)) & 0xFFFF
    return whole + total.to_bytes(2, "big")


def packets(
    rows: Track,
    *,
    absolute: bool = False,
    ground_m: float | None = 0.0,
    gimbal: bool = True,
    ellipsoid: bool = False,
) -> list[bytes]:
    """A packet per row. ground_m: height of the plane of the frame centre; None: packets without one."""
    result = []
    for i, time_s in enumerate(rows.times_s - rows.times_s[0]):
        camera = (float(rows.yaw_rad[i]), float(rows.pitch_rad[i]), float(rows.roll_rad[i]))
        aircraft = aircraft_of(camera[0])
        sensor = camera if absolute else relative_angles(camera, aircraft)
        height_m = float(rows.absolute_height_m[i])
        values = {
            5: math.degrees(aircraft[0]) % 360.0,
            6: math.degrees(aircraft[1]),
            7: math.degrees(aircraft[2]),
            13: float(rows.latitude_deg[i]),
            14: float(rows.longitude_deg[i]),
            75 if ellipsoid else 15: height_m,
        }
        if gimbal:
            turned = [math.degrees(v) for v in sensor]
            values |= {18: turned[0] % 360.0, 19: turned[1], 20: turned[2] % 360.0}
        if ground_m is not None and camera[1] < -0.05:
            away_m = (height_m - ground_m) / math.tan(-camera[1])
            north_m, east_m = away_m * math.cos(camera[0]), away_m * math.sin(camera[0])
            values |= {
                23: values[13] + math.degrees(north_m / 6.371e6),
                24: values[14] + math.degrees(east_m / 6.371e6 / math.cos(math.radians(values[13]))),
                25: ground_m,
            }
        result.append(packet(rows.start_time_ns // 1000 + round(time_s * 1e6), values))
    return result


def write(path: Path, rows: Track, **kept: object) -> None:
    path.write_bytes(b"".join(packets(rows, **kept)))  # type: ignore[arg-type]


def write_stream(
    path: Path, pieces: Sequence[bytes], times_s: Sequence[float], *, pictures: int = 30, rate: int = 10,
    first_s: float = 1.4,
) -> None:  # fmt: skip
    """A transport stream of a small video and the pieces; the first picture is at first_s."""
    import av

    with av.open(str(path), "w", format="mpegts") as out:
        video = out.add_stream("mpeg4", rate=rate)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        data = out.add_data_stream("klv")
        ticks = Fraction(1, 90_000)
        waiting = list(zip(times_s, pieces, strict=True))
        for i in range(pictures):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 8 * i % 256, np.uint8), format="rgb24")
            frame.pts, frame.time_base = i, Fraction(1, rate)
            for encoded in video.encode(frame):
                encoded.pts = encoded.dts = round((first_s + i / rate) * 90_000)
                encoded.time_base = ticks
                out.mux(encoded)
            while waiting and waiting[0][0] < (i + 1) / rate:
                time_s, piece = waiting.pop(0)
                own = av.Packet(piece)
                own.stream = data
                own.time_base = ticks
                own.pts = own.dts = round((first_s + time_s) * 90_000)
                out.mux(own)


def write_metadata_stream(
    path: Path, pieces: Sequence[bytes], delay_s: float, *, synchronous: bool, presentation_times: bool = True
) -> None:
    """A transport stream as tstrans lays it down: a piece after each picture, in access units if synchronous."""
    from tstrans import mpegts

    kind = mpegts.KlvStreamType.SYNCHRONOUS_METADATA if synchronous else mpegts.KlvStreamType.PRIVATE_DATA
    program = mpegts.MuxerProgramConfigBuilder(1, 0x100).add_video(0x101, mpegts.VideoCodec.H264)
    program = program.add_klv(0x102, kind, carries_pts=presentation_times).pcr_pid(0x101)
    muxer = mpegts.Muxer(mpegts.MuxerConfigBuilder().add_program(program.build()).build())
    out = bytearray()
    for i, (picture, is_key) in enumerate(_pictures(len(pieces))):
        time = 126_000 + 9_000 * i
        muxer.push_video(picture, pts=mpegts.Pts90khz(time), key_frame=is_key)
        muxer.push_klv(pieces[i], pts=mpegts.Pts90khz(time + round(delay_s * 90_000)))
        room = bytearray(188 * 64)
        while count := muxer.pull(room):
            out += room[: count * 188]
    path.write_bytes(bytes(out))


def _pictures(count: int) -> list[tuple[bytes, bool]]:
    import io

    import av

    with av.open(io.BytesIO(), "w", format="h264") as out:
        video = out.add_stream("libx264", rate=10)
        video.width, video.height, video.pix_fmt, video.options = 64, 48, "yuv420p", {"bf": "0", "g": "5"}
        encoded = []
        for i in range(count):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 8 * i % 256, np.uint8), format="rgb24")
            frame.pts, frame.time_base = i, Fraction(1, 10)
            encoded += video.encode(frame)
        return [(bytes(packet), packet.is_keyframe) for packet in encoded + video.encode(None)]

"""GoPro's telemetry (GPMF): the metadata track of an MP4, or that track alone.

GPS9 (since the Hero 11) or GPS5: positions, ten or eighteen a second. A GoPro knows neither north nor, without a
gimbal, where it looks: the mission says ``gimbal: {pitch: .., yaw: course}``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import av
import numpy as np

from pipeline.config.telemetry import Telemetry
from pipeline.config.terrain import Datum
from pipeline.errors import InputError
from pipeline.ingest.samples import LeftOut, Sample, track_of
from pipeline.ingest.satellite_fix import FIX_3D, height_sd_m, horizontal_sd_m
from pipeline.ingest.telemetry.binary_file import read_bytes
from pipeline.ingest.telemetry.gpmf_items import Item, items_of, nests_of, scale_of
from pipeline.ingest.track import Track
from pipeline.messages import FloatArray

EXPECTED = "GoPro telemetry (GPMF) with GPS, bare or in an MP4"
_OPTIONS = {"format_whitelist": "mov", "protocol_whitelist": "file"}
_HANDLER = "GoPro MET"
#: how long a payload lasts where nothing tells it: 30 pictures at 29.97 Hz
_PAYLOAD_S = 1.001
_FIRST_YEAR = 2014  # no GoPro with GPS is older; an unset clock says 2000 or 2015-01-01
_EPOCH_2000_S = 946_684_800.0
#: dilution of 99.99 is none
_NO_DILUTION = 99.0


@dataclass(frozen=True, slots=True)
class Payload:
    """About a second of telemetry. start_s, end_s: since the video's first picture."""

    data: bytes
    start_s: float
    end_s: float


def is_gopro_gpmf(path: Path, head: bytes) -> bool:
    """Whether a file is bare GPMF, or an MP4 with a track of it."""
    if head[:4] == b"DEVC":
        return True
    return (
        head[4:8] == b"ftyp" and path.suffix.lower() in (".mp4", ".mov", ".360", ".lrv") and _has_track(path)
    )


def read_gopro_gpmf(telemetry: Telemetry) -> Track:
    """The samples of a file. Raises InputError if none can be used."""
    path, left_out, assumed = telemetry.file, LeftOut(), list[str]()
    with path.open("rb") as file:
        bare = file.read(4) == b"DEVC"
    if bare:
        assumed.append(f"each payload of bare GPMF lasts {_PAYLOAD_S} s and the first begins with the video")
        payloads = _bare_payloads(read_bytes(path, EXPECTED))
    else:
        payloads = _track_payloads(path)
    samples, datums, names = [], set(), []
    for number, payload in enumerate(payloads, 1):
        where = f"{path} payload {number}"
        for stream in nests_of(payload.data, "STRM"):
            samples += _samples(stream, payload, where, left_out)
            datums |= {_datum(stream)} if any(i.key in ("GPS5", "GPS9") for i in stream) else set()
        names += [i.text() for device in nests_of(payload.data, "DEVC") for i in device if i.key == "DVNM"][
            :1
        ]
    if not samples and not left_out.counts:
        raise InputError(path, "GPMF without GPS", EXPECTED)
    return track_of(
        path,
        samples,
        expected=f"{EXPECTED}: was GPS switched on?",
        clock="utc",
        left_out=left_out,
        tied_to_video=True,
        height_datum=datums.pop() if len(datums) == 1 else None,
        camera_name=names[0] if names else None,
        assumed=assumed,
    )


def _has_track(path: Path) -> bool:
    try:
        with av.open(str(path), options=_OPTIONS) as container:
            return any(_is_metadata(stream) for stream in container.streams)
    except (av.FFmpegError, OSError):
        return False


def _is_metadata(stream: av.stream.Stream) -> bool:
    return stream.type == "data" and _HANDLER in stream.metadata.get("handler_name", "")


def _track_payloads(path: Path) -> list[Payload]:
    payloads = []
    try:
        with av.open(str(path), options=_OPTIONS) as container:
            stream = next((s for s in container.streams if _is_metadata(s)), None)
            if stream is None:
                raise InputError(path, "an MP4 without a track of GoPro's telemetry", EXPECTED)
            video = container.streams.best("video")
            first_s = 0.0
            if video is not None and video.start_time is not None and video.time_base is not None:
                first_s = float(video.start_time * video.time_base)
            for packet in container.demux(stream):
                if packet.size and packet.pts is not None and packet.time_base is not None:
                    start_s = float(packet.pts * packet.time_base) - first_s
                    lasts_s = float((packet.duration or 0) * packet.time_base) or _PAYLOAD_S
                    payloads.append(Payload(bytes(packet), start_s, start_s + lasts_s))
    except (av.FFmpegError, OSError) as error:
        if not payloads:
            raise InputError(path, f"a file that cannot be read ({error.strerror})", EXPECTED) from None
    return payloads


def _bare_payloads(data: bytes) -> list[Payload]:
    """Each device's nest (DEVC) on the first level is a payload."""
    payloads: list[Payload] = []
    position = 0
    while (start := data.find(b"DEVC", position)) >= 0:
        item = next(items_of(data[start : start + 8 + 16_777_216]), None)
        length = 8 if item is None else 8 + -(-len(item.data) // 4) * 4
        start_s = len(payloads) * _PAYLOAD_S
        # one that is cut off is given to its end: its whole streams are read
        end = len(data) if item is None else start + length
        payloads.append(Payload(data[start:end], start_s, start_s + _PAYLOAD_S))
        position = max(end, start + 8)
    return payloads


def _samples(stream: Sequence[Item], payload: Payload, where: str, left_out: LeftOut) -> list[Sample]:
    """The positions of a stream, spread over the time of its payload."""
    items = {item.key: item for item in stream}
    if "GPS9" not in items and "GPS5" not in items:
        return []
    scale = scale_of(list(stream))
    own = items.get("GPS9") or items["GPS5"]
    rows = own.table(items["TYPE"].text() if "TYPE" in items else "")
    if not len(rows) or rows.shape[1] < 5 or len(scale) not in (1, rows.shape[1]):
        left_out.add("unreadable", where)
        return []
    rows = rows / scale
    utc_s, fix, dilution = _gps9(rows) if own.key == "GPS9" else _gps5(items, len(rows))
    known = np.where(dilution < _NO_DILUTION, dilution, math.nan)
    horizontal = horizontal_sd_m(fix, np.full(len(rows), math.nan), known)
    height = height_sd_m(fix, np.full(len(rows), math.nan), known, known)
    step_s = (payload.end_s - payload.start_s) / len(rows)
    samples = []
    for i, (latitude, longitude, altitude, *_) in enumerate(rows.tolist()):
        values = {"latitude": latitude, "longitude": longitude, "absolute_height": altitude}
        values |= {"horizontal_sd": float(horizontal[i]), "height_sd": float(height[i])}
        date_ns = round(utc_s[i] * 1e9) if math.isfinite(utc_s[i]) else None
        time_s = payload.start_s + i * step_s
        samples.append(Sample(where, time_s, values, date_ns, has_fix=bool(fix[i] >= FIX_3D)))
    return samples


def _gps9(rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Date, fix and dilution of each sample: days since 2000, seconds of the day, dilution, fix."""
    if rows.shape[1] < 9:
        nothing = np.full(len(rows), math.nan)
        return nothing, np.zeros(len(rows)), nothing
    utc_s = _EPOCH_2000_S + rows[:, 5] * 86_400.0 + rows[:, 6]
    first_s = datetime(_FIRST_YEAR, 1, 1, tzinfo=UTC).timestamp()
    return np.where(utc_s > first_s, utc_s, math.nan), rows[:, 8], rows[:, 7]


def _gps5(items: dict[str, Item], count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same of a payload of GPS5: its date, fix and dilution stand beside it."""
    utc_s = np.full(count, math.nan)
    if "GPSU" in items:
        utc_s[0] = _date_s(items["GPSU"].text())
    fix = _first(items.get("GPSF"), 3.0)
    return utc_s, np.full(count, fix), np.full(count, _first(items.get("GPSP"), math.nan) / 100.0)


def _first(item: Item | None, otherwise: float) -> float:
    table = np.zeros((0, 0)) if item is None else item.table()
    return float(table[0, 0]) if table.size else otherwise


def _date_s(text: str) -> float:
    """``yymmddhhmmss.sss``, UTC."""
    try:
        moment = datetime.strptime(text, "%y%m%d%H%M%S.%f").replace(tzinfo=UTC)
    except ValueError:
        return math.nan
    return moment.timestamp() if moment.year >= _FIRST_YEAR else math.nan


def _datum(stream: Sequence[Item]) -> Datum | None:
    """``GPSA`` says MSLV where heights are above sea level; without it GoPros differ, and the datum is left open."""
    system = next((item.text() for item in stream if item.key == "GPSA"), "")
    return "geoid" if system.startswith("MSL") else None

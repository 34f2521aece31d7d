"""MISB ST 0601 metadata (KLV): a file of packets, or the metadata track of an MPEG transport stream.

Tags used: 2 time; 5, 6, 7 (or 90, 91) heading, pitch and roll of the aircraft; 13, 14 position; 75 (or 104) height
above the ellipsoid, else 15 above sea level; 16 horizontal field of view; 18, 19, 20 (and 23 to 25) the camera.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.config.telemetry import Telemetry
from pipeline.config.terrain import Datum
from pipeline.errors import InputError
from pipeline.ingest.attitude import camera_on_aircraft
from pipeline.ingest.samples import LeftOut, Sample, track_of
from pipeline.ingest.telemetry.binary_file import read_bytes
from pipeline.ingest.telemetry.misb_azimuth import Reading, azimuth_reading
from pipeline.ingest.telemetry.misb_packets import KEY, OLD_KEY, MisbPacket, packets_of
from pipeline.ingest.telemetry.misb_stream import KlvPiece, is_transport_stream, klv_pieces
from pipeline.ingest.track import Track
from pipeline.messages import FloatArray

EXPECTED = "MISB ST 0601 metadata (KLV), bare or in an MPEG transport stream"
FIRST_DATE_US = 631_152_000_000_000  # 1990-01-01: a clock that was never set counts from 1970
#: packets of one piece share its presentation time; their own times tell them apart, up to so much
_LONGEST_PIECE_S = 10.0


def is_misb_klv(path: Path, head: bytes) -> bool:
    """Whether a file begins with packets of KLV, or is a transport stream."""
    return KEY in head or OLD_KEY in head or is_transport_stream(head) or path.suffix.lower() == ".klv"


def read_misb_klv(telemetry: Telemetry) -> Track:
    """The samples of a file. Raises InputError if none can be used, or if it is not clear what angles count from."""
    path, left_out, assumed = telemetry.file, LeftOut(), list[str]()
    with path.open("rb") as file:
        in_stream = is_transport_stream(file.read(4096))
    pieces = (
        klv_pieces(path, left_out)
        if in_stream
        else [KlvPiece(read_bytes(path, EXPECTED), math.nan, math.nan)]
    )
    packets = list(packets_of([piece.data for piece in pieces], path, left_out))
    if not packets and not left_out.counts:
        old = any(OLD_KEY in piece.data for piece in pieces)
        raise InputError(path, "the older universal set EG 0104" if old else "no packet of ST 0601", EXPECTED)
    times_s = _times_s(packets, pieces, in_stream, assumed)
    return track_of_packets(path, packets, times_s, telemetry, left_out, assumed, tied_to_video=in_stream)


def track_of_packets(
    path: Path,
    packets: Sequence[MisbPacket],
    times_s: Sequence[float] | FloatArray,
    telemetry: Telemetry,
    left_out: LeftOut,
    assumed: Sequence[str] = (),
    *,
    tied_to_video: bool = True,
) -> Track:
    """The samples of packets, at their times (N,), seconds. Raises InputError as read_misb_klv does."""
    said = list(assumed)
    columns, datum = _columns(path, packets, telemetry, said)
    samples = []
    for i, packet in enumerate(packets):
        values = {name: float(column[i]) for name, column in columns.items() if math.isfinite(column[i])}
        stamp_us = packet.fields.timestamp_us or 0
        date_ns = stamp_us * 1000 if stamp_us > FIRST_DATE_US else None
        samples.append(Sample(f"{path} packet {packet.number}", float(times_s[i]), values, date_ns))
    return track_of(
        path,
        samples,
        expected=EXPECTED,
        clock="utc",
        left_out=left_out,
        tied_to_video=tied_to_video,
        height_datum=datum,
        assumed=said,
    )


def _columns(
    path: Path, packets: Sequence[MisbPacket], telemetry: Telemetry, assumed: list[str]
) -> tuple[dict[str, FloatArray], Datum]:
    """The fields of the packets by the names of ``samples.FIELDS``, (N,) each, NaN where absent."""
    latitude, longitude = (_field(packets, name) for name in ("sensor_lat_deg", "sensor_lon_deg"))
    height, datum = _height(packets)
    aircraft, sensor = _aircraft(packets), _sensor(packets)
    camera = np.full(sensor.shape, math.nan)
    reading = reading_of(path, packets, telemetry, assumed)
    if reading is not None:
        own, relative = np.radians(aircraft), np.radians(sensor)
        camera = (
            np.degrees(camera_on_aircraft(own, relative)) if reading == "relative" else _from_north(relative)
        )
    half_view = np.radians(_field(packets, "sensor_hfov_deg")) / 2.0
    with np.errstate(divide="ignore", invalid="ignore"):
        focal_mm = np.where(half_view > 0.0, 18.0 / np.tan(half_view), math.nan)
    return {
        "latitude": latitude,
        "longitude": longitude,
        "absolute_height": height,
        **dict(zip(("yaw", "pitch", "roll"), camera.T, strict=True)),
        **dict(zip(("aircraft_yaw", "aircraft_pitch", "aircraft_roll"), aircraft.T, strict=True)),
        "focal_length_35mm": focal_mm,
    }, datum


def reading_of(
    path: object, packets: Sequence[MisbPacket], telemetry: Telemetry, assumed: list[str]
) -> Reading | None:
    """What the camera's angles count from; None if there are none. Raises InputError if nothing fits."""
    sensor = _sensor(packets)
    if not np.isfinite(sensor).all(axis=1).any():
        return None
    places = [_field(packets, name) for name in ("sensor_lat_deg", "sensor_lon_deg")]
    positions = np.stack([*places, _height(packets)[0]], axis=1)
    centres = np.stack(
        [_field(packets, f"frame_center_{name}") for name in ("lat_deg", "lon_deg", "elev_m")], axis=1
    )
    own, relative = np.radians(_aircraft(packets)), np.radians(sensor)
    return azimuth_reading(path, telemetry.sensor_azimuth, own, relative, positions, centres, assumed)


def _aircraft(packets: Sequence[MisbPacket]) -> FloatArray:
    """Heading, pitch and roll of the aircraft, degrees (N, 3)."""
    return np.stack(
        [
            _field(packets, "platform_heading_deg"),
            _field(packets, "platform_pitch_full_deg", "platform_pitch_deg"),
            _field(packets, "platform_roll_full_deg", "platform_roll_deg"),
        ],
        axis=1,
    )


def _sensor(packets: Sequence[MisbPacket]) -> FloatArray:
    """Azimuth, elevation and roll of the camera, degrees (N, 3)."""
    return np.stack(
        [
            _field(packets, "sensor_rel_az_deg"),
            _field(packets, "sensor_rel_el_deg"),
            np.nan_to_num(_field(packets, "sensor_rel_roll_deg")),
        ],
        axis=1,
    )


def _height(packets: Sequence[MisbPacket]) -> tuple[FloatArray, Datum]:
    """Heights above the ellipsoid where at least as many packets have them as those above the geoid."""
    ellipsoid = _field(packets, "sensor_ellipsoid_height_extended_m", "sensor_ellipsoid_height_m")
    geoid = _field(packets, "sensor_alt_m")
    if np.isfinite(ellipsoid).any() and np.isfinite(ellipsoid).sum() >= np.isfinite(geoid).sum():
        return ellipsoid, "ellipsoid"
    return geoid, "geoid"


def _field(packets: Sequence[MisbPacket], *names: str) -> FloatArray:
    """The first of the fields that a packet has, (N,), NaN without."""
    return np.array(
        [next((v for v in (_number(p.fields, n) for n in names) if v is not None), math.nan) for p in packets]
    )


def _number(fields: Any, name: str) -> float | None:
    value = getattr(fields, name)
    return None if value is None else float(value)


def _times_s(
    packets: Sequence[MisbPacket], pieces: Sequence[KlvPiece], in_stream: bool, assumed: list[str]
) -> FloatArray:
    """Time of the video of each packet, or, in a bare file, since the first one; NaN for a packet without."""
    stamps_s = np.array(
        [math.nan if p.fields.timestamp_us is None else p.fields.timestamp_us * 1e-6 for p in packets]
    )
    if not len(packets):
        return stamps_s
    if not in_stream:
        return np.asarray(
            stamps_s - (stamps_s[np.isfinite(stamps_s)][0] if np.isfinite(stamps_s).any() else 0.0)
        )
    shown_s = np.array([pieces[p.piece].time_s for p in packets])
    if np.isnan(shown_s).mean() > 0.5:
        # asynchronous metadata has no time of its own: its place among the pictures, over all packets, tells it
        video_s = np.array([pieces[p.piece].video_s for p in packets])
        assumed.append(
            "the KLV track has no presentation times: tied to the video by its place in the file, to about a picture"
        )
        if not np.isfinite(video_s - stamps_s).any():
            return video_s
        return np.asarray(stamps_s + np.nanmedian(video_s - stamps_s))
    numbers = np.array([p.piece for p in packets])
    first = np.searchsorted(numbers, numbers)
    since_s = np.nan_to_num(stamps_s - stamps_s[first])
    return np.asarray(shown_s + np.where((since_s >= 0.0) & (since_s < _LONGEST_PIECE_S), since_s, 0.0))


def _from_north(sensor_rad: FloatArray) -> FloatArray:
    """Angles (N, 3) in degrees of a camera whose own count from north; elevations past straight down turned about."""
    return np.degrees(camera_on_aircraft(np.zeros(sensor_rad.shape), sensor_rad))

"""The metadata of a folder of stills: EXIF (CIPA DC-008) and the XMP that DJI's and Parrot's drones add."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any

from PIL import Image

from pipeline.errors import InputError
from pipeline.geo.camera import Camera
from pipeline.ingest.cameras.dji_calibration import TAGS, common_camera, dji_camera
from pipeline.ingest.samples import LeftOut, Sample, track_of
from pipeline.ingest.track import Track

ENDINGS = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".dng"})
EXPECTED = "stills with date and position in their EXIF (JPEG, TIFF, DNG)"
#: metadata stand before the picture
_HEAD_BYTES = 1 << 19
_XMP = re.compile(rb'drone-(?:dji|parrot):(\w+)(?:\s*=\s*"([^"]*)"|>([^<]*)<)')
_FIELDS = {
    "GpsLatitude": "latitude",
    "GpsLongitude": "longitude",
    "GpsLongtitude": "longitude",  # so spelt by older ones
    "RelativeAltitude": "relative_height",
    "AbsoluteAltitude": "absolute_height",
    "GimbalYawDegree": "yaw",
    "GimbalPitchDegree": "pitch",
    "GimbalRollDegree": "roll",
    "CameraYawDegree": "yaw",
    "CameraPitchDegree": "pitch",
    "CameraRollDegree": "roll",
    "FlightYawDegree": "aircraft_yaw",
    "FlightPitchDegree": "aircraft_pitch",
    "FlightRollDegree": "aircraft_roll",
    "RtkStdHgt": "height_sd",
}
_EXIF, _GPS = 0x8769, 0x8825
_TAKEN, _SUBSECONDS, _OFFSET, _FOCAL_35MM = 0x9003, 0x9291, 0x9011, 0xA405
#: of the file, where a program has thrown the date of the picture away
_DIGITIZED, _CHANGED = 0x9004, 0x0132
#: what DJI's drones of several cameras put behind a name, the one that is searched in first: visible, wide, zoom
_LENS = re.compile(r"_([VWZTS])\.\w+$", re.IGNORECASE)
_PREFERRED = "VWZTS"
_MAKE, _MODEL, _ORIENTATION = 0x010F, 0x0110, 0x0112


@dataclass(frozen=True, slots=True)
class StillTags:
    """date_ns: when it was taken, ns since 1970; on UTC if is_utc, else on the camera's local time.

    values: by the names of a Sample's fields. camera: the maker's and the model's name. size: of the picture as it is
    stored, pixels; 0, 0 if it lies on its side. lens: what DJI's XMP says of the camera itself, tag -> text.
    """

    path: Path
    date_ns: int | None
    is_utc: bool
    values: Mapping[str, float]
    camera: str | None
    size: tuple[int, int] = (0, 0)
    lens: Mapping[str, str] = field(default_factory=dict)


def is_stills(path: Path, head: bytes) -> bool:
    """Whether it is a folder."""
    return path.is_dir()


def read_stills(folder: Path) -> Track:
    """One sample for each still with a date, on the clock of ``dated_stills``. Raises InputError if none is left."""
    stills, left_out = dated_stills(folder)
    is_utc = all(s.is_utc for s in stills)
    start_ns = stills[0].date_ns or 0
    samples = [Sample(s.path.name, ((s.date_ns or 0) - start_ns) * 1e-9, s.values, s.date_ns) for s in stills]
    return track_of(
        folder,
        samples,
        expected=EXPECTED,
        clock="utc" if is_utc else "local",
        left_out=left_out,
        camera_name=stills[0].camera,
    )


def dated_stills(folder: Path) -> tuple[list[StillTags], LeftOut]:
    """The stills that say when they were taken, in that order; what is left out.

    Raises InputError for a folder without any.
    """
    if not folder.is_dir():
        raise InputError(folder, "no folder", "a folder of stills")
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in ENDINGS and p.is_file())
    left_out, dated = LeftOut(), []
    for tags in map(tags_of, files):
        if tags.date_ns is None:
            left_out.add("no_date", tags.path.name)
        else:
            dated.append(tags)
    if not dated:
        raise InputError(folder, f"no still with a date, of {len(files)}", EXPECTED)
    kept = _of_one_camera(dated)
    of_it = {tags.path for tags in kept}
    for tags in dated:
        if tags.path not in of_it:
            left_out.add("other_camera", tags.path.name)
    return sorted(kept, key=lambda s: (s.date_ns or 0, s.path.name)), left_out


def _of_one_camera(stills: Sequence[StillTags]) -> list[StillTags]:
    """A drone takes with all its cameras at once: the stills of one, by the letter in their names, or their size.

    Of letters the most preferred, of sizes the one that most have, of them the largest.
    """
    letters = {m[1].upper() for s in stills if (m := _LENS.search(s.path.name)) is not None}
    if len(letters) > 1:
        letter = min(letters, key=_PREFERRED.index)
        return [s for s in stills if (m := _LENS.search(s.path.name)) is not None and m[1].upper() == letter]
    sizes = Counter(s.size for s in stills if s.size != (0, 0))
    if len(sizes) < 2:
        return list(stills)
    usual = max(sizes, key=lambda size: (sizes[size], size[0] * size[1]))
    return [s for s in stills if s.size in (usual, (0, 0))]


def tags_of(path: Path) -> StillTags:
    """What one file says; nothing if it cannot be read."""
    try:
        with Image.open(path) as image:
            exif = image.getexif()
            own, gps = exif.get_ifd(_EXIF), exif.get_ifd(_GPS)
            camera = _camera(exif.get(_MAKE), exif.get(_MODEL))
            size = image.size if exif.get(_ORIENTATION, 1) < 5 else (0, 0)
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError):
        return StillTags(path, None, False, {}, None)
    date_ns, is_utc = _date({_CHANGED: exif.get(_CHANGED), **own})
    focal = _number(own.get(_FOCAL_35MM))
    xmp = {m[1].decode(): (m[2] or m[3] or b"").decode("ascii", "replace") for m in _XMP.finditer(head)}
    values = _position(gps) | ({"focal_length_35mm": focal} if focal else {}) | _of_xmp(xmp)
    return StillTags(
        path, date_ns, is_utc, values, camera, size, {tag: xmp[tag] for tag in TAGS if tag in xmp}
    )


def camera_of(stills: Sequence[StillTags]) -> Camera | None:
    """The camera that DJI's drones write into their stills; None if they do not, or not of one lens."""
    return common_camera([dji_camera(still.lens, *still.size) for still in stills])


def _camera(make: object, model: object) -> str | None:
    """Maker and model in one, the maker once."""
    maker, name = (str(part or "").strip("\0 ") for part in (make, model))
    if not name:
        return None
    return name if not maker or name.lower().startswith(maker.lower()) else f"{maker} {name}"


def _date(tags: Mapping[int, Any]) -> tuple[int | None, bool]:
    written = (str(tags.get(tag) or "").strip("\0 ") for tag in (_TAKEN, _DIGITIZED, _CHANGED))
    moment = next((m for text in written if (m := _moment(text)) is not None), None)
    if moment is None:
        return None, False
    digits = re.match(r"\d+", str(tags.get(_SUBSECONDS, "")).strip())
    part_s = float(f"0.{digits.group()}") if digits else 0.0
    offset = re.fullmatch(r"([+-])(\d\d):(\d\d)", str(tags.get(_OFFSET, "")).strip("\0 "))
    zone: timezone = UTC
    if offset:
        minutes = int(offset[2]) * 60 + int(offset[3])
        zone = timezone(timedelta(minutes=-minutes if offset[1] == "-" else minutes))
    whole_s = round(moment.replace(tzinfo=zone).timestamp())
    return whole_s * 1_000_000_000 + round(part_s * 1e9), offset is not None


def _moment(text: str) -> datetime | None:
    try:
        return datetime.strptime(text.replace("-", ":"), "%Y:%m:%d %H:%M:%S")
    except ValueError:
        return None


def _position(gps: Mapping[int, Any]) -> dict[str, float]:
    values = {}
    for name, sign_tag, tag, negative in (("latitude", 1, 2, "S"), ("longitude", 3, 4, "W")):
        parts = gps.get(tag)
        numbers = [_number(p) for p in parts] if isinstance(parts, tuple) else []
        if len(numbers) == 3 and all(n is not None for n in numbers):
            degrees = sum((n or 0.0) / 60.0**k for k, n in enumerate(numbers))
            letter = gps.get(sign_tag, "")
            letter = letter.decode("ascii", "replace") if isinstance(letter, bytes) else str(letter)
            values[name] = -degrees if letter.strip("\0 ").upper().startswith(negative) else degrees
    height = _number(gps.get(6))
    if height is not None:
        below = gps.get(5) in (1, b"\x01")
        values["absolute_height"] = -height if below else height
    return values


def _of_xmp(tags: Mapping[str, str]) -> dict[str, float]:
    values = {
        field: number for tag, field in _FIELDS.items() if (number := _number(tags.get(tag))) is not None
    }
    sides = [n for tag in ("RtkStdLon", "RtkStdLat") if (n := _number(tags.get(tag))) is not None]
    return values | ({"horizontal_sd": max(sides)} if sides else {})


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if abs(number) < 1e9 else None

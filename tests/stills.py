"""Stills with a drone's metadata, for tests."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image


def write_still(
    path: Path,
    image: NDArray[np.uint8],
    taken: datetime,
    latitude_deg: float,
    longitude_deg: float,
    height_m: float,
    xmp: Mapping[str, str],
    offset: str | None = None,
) -> Path:
    """As DJI writes it: EXIF with position and date, XMP with what xmp says."""
    exif = Image.Exif()
    exif[0x0110] = "FC3411"
    own = exif.get_ifd(0x8769)
    own[0x9003] = taken.strftime("%Y:%m:%d %H:%M:%S")
    own[0x9291] = f"{taken.microsecond:06}"
    own[0xA405] = 24
    if offset:
        own[0x9011] = offset
    exif.get_ifd(0x8825).update(
        {
            1: "N" if latitude_deg >= 0 else "S",
            2: _sexagesimal(latitude_deg),
            3: "E" if longitude_deg >= 0 else "W",
            4: _sexagesimal(longitude_deg),
            5: b"\x00",
            6: height_m,
        }
    )
    attributes = " ".join(f'drone-dji:{k}="{v}"' for k, v in xmp.items())
    packet = f'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:Description {attributes}/></x:xmpmeta>'
    Image.fromarray(image).save(path, exif=exif, xmp=packet.encode(), quality=95)
    return path


def _sexagesimal(degrees: float) -> tuple[float, float, float]:
    whole = abs(degrees)
    minutes = (whole - int(whole)) * 60.0
    return float(int(whole)), float(int(minutes)), round((minutes - int(minutes)) * 60.0, 5)

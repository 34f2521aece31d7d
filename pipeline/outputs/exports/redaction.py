"""What is taken from a run before it leaves the team: exact positions, ways, faces."""

from __future__ import annotations

import io
from dataclasses import replace

from PIL import Image

from pipeline.outputs.exports.view import PictureOf, Place, RunView

#: positions are rounded to so many decimals of a degree: 0.01 degrees are 1.1 km north, at most that east
DECIMALS = 2
#: a picture keeps so many blocks a side: a person of 20 pixels in 144 is one of them
BLOCKS = 8
SENTENCE = (
    f"Redacted: positions are rounded to {10**-DECIMALS:g} degrees (about 1 km), pictures are blurred; heights, error "
    "ellipses, drones' ways, search area, areas worth a second look, the probability layer, names of video files, "
    "streams and machines are left out."
)


def redacted(view: RunView) -> RunView:
    """The same run without what says exactly where, who, and with what."""
    return replace(
        view,
        places=tuple(_place(place) for place in view.places),
        areas=(),
        tracks=(),
        second_look=(),
        saliency=None,
        shifts=(),
        map_png=None,
        # they name files, streams and machines
        limits=(),
        redacted=SENTENCE,
    )


def _place(place: Place) -> Place:
    return replace(
        place,
        latitude_deg=round(place.latitude_deg, DECIMALS),
        longitude_deg=round(place.longitude_deg, DECIMALS),
        ellipsoidal_m=None,
        height_m=None,
        height_datum="left out",
        error=None,
        streams=(),
        setups=(),
        pictures=tuple(_picture(picture) for picture in place.pictures),
        mgrs_digits=2,
        decided=(),  # they name reviewers
    )


def _picture(picture: PictureOf) -> PictureOf:
    return PictureOf(blurred(picture.png), "", picture.time)


def blurred(png: bytes) -> bytes:
    """The picture as BLOCKS x BLOCKS mean colours, drawn softly at its size; what else its file says is gone."""
    with Image.open(io.BytesIO(png)) as picture:
        size, small = picture.size, picture.convert("RGB").resize((BLOCKS, BLOCKS), Image.Resampling.BOX)
    buffer = io.BytesIO()
    small.resize(size, Image.Resampling.BILINEAR).save(buffer, format="PNG")
    return buffer.getvalue()

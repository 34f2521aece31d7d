"""What all formats say of a place, in words, and the ellipse about it as points."""

from __future__ import annotations

import re
from datetime import datetime

import numpy as np
from pyproj import Geod

from pipeline.fusion.error_ellipse import ErrorEllipse
from pipeline.outputs.exports.view import PictureOf, Place, Point, RunView
from pipeline.outputs.place_picture import minutes_seconds

_WGS84 = Geod(ellps="WGS84")
#: what XML 1.0 cannot hold, and other characters that nobody sees
_UNSEEN = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff\u202a-\u202e\u2066-\u2069]"
)
#: found places, possible places: apart from each other also for the colour-blind (Okabe and Ito), RRGGBB
COLORS = {"found": "D55E00", "possible": "E69F00"}


def clean(text: str) -> str:
    """A text from outside without characters that no file may hold; markup in it stays text."""
    return _UNSEEN.sub("", text)


def what_to_do(place: Place) -> str:
    """The next step, as far as the map and its reviewers can say it."""
    if place.state == "rejected":
        return "Rejected by a reviewer: no team for this alone."
    if place.state == "contradicted":
        return "Reviewers contradict each other: look at the pictures together."
    if place.state == "confirmed":
        return "Confirmed by a reviewer: send a team."
    if place.kind == "possible":
        return "Look at the pictures; look again from the air before a team goes."
    if place.may_be:
        others = " and ".join(str(other) for other in place.may_be)
        return f"Look at the pictures, then send a team; may be the same person as place {others}."
    return "Look at the pictures, then send a team."


def said_of(place: Place, view: RunView) -> list[tuple[str, str]]:
    """Label and text, of all that is known; nothing of what is not."""
    utm, error = place.utm, place.error
    lines = [
        ("What to do", what_to_do(place)),
        ("Class", place.class_name),
        ("Probability", f"{place.probability:.1%}"),
        ("MGRS", place.mgrs),
        ("Latitude, longitude (WGS84)", place.position),
    ]
    if utm is not None and not view.redacted:
        lines.append(("UTM (WGS84)", utm.text))
    if place.height_m is not None:
        lines.append(("Height", f"{place.height_m:.1f} m, datum: {place.height_datum}"))
    if error is not None:
        size = f"± {error.semi_major_m:.1f} × {error.semi_minor_m:.1f} m"
        size += f", long axis {error.orientation_deg:.0f}° from north"
        lines.append(("Error ellipse, 95 %", size))
    first, last = (local_time(at, place.clock, view) for at in (place.first_seen, place.last_seen))
    lines.append(("Seen", f"{first} to {last}"))
    lines.append(("Looks, sightings", f"{place.looks}, {place.sightings}"))
    if place.streams:
        lines.append(("Streams", ", ".join(place.streams)))
    lines += [("Decided", sentence) for sentence in place.decided]
    lines += [("In the video", where) for where in map(in_video, place.pictures) if where]
    if view.redacted:
        lines.append(("Note", view.redacted))
    return [(label, clean(text)) for label, text in lines]


def local_time(time: str, clock: str, view: RunView) -> str:
    """``2026-05-01 12:00:03 CEST``: a time as people read it, in the run's zone; one not on UTC stays as it is."""
    if clock != "UTC" or view.time_zone is None:
        return f"{time[:19].replace('T', ' ')} {clock}"
    return f"{datetime.fromisoformat(time).astimezone(view.time_zone):%Y-%m-%d %H:%M:%S %Z}"


def in_video(picture: PictureOf) -> str:
    """Where to find it again; empty where that is not known or left out."""
    if picture.file is None:
        return ""
    if picture.file_s is None:
        return f"{picture.stream}, {picture.file}"
    return f"{picture.stream}, {picture.file} at {minutes_seconds(picture.file_s)}, frame {picture.frame}"


def outline(place: Place) -> list[Point]:
    """The error ellipse as a closed ring that goes round to the left; empty where it is left out."""
    if place.error is None:
        return []
    error = place.error
    ellipse = ErrorEllipse(error.semi_major_m, error.semi_minor_m, error.orientation_deg, np.eye(2))
    east_north = ellipse.outline(49)[::-1]
    azimuth, meters = np.degrees(np.arctan2(*east_north.T)), np.hypot(*east_north.T)
    from_east, from_north = (np.full_like(meters, at) for at in (place.longitude_deg, place.latitude_deg))
    longitude, latitude, _ = _WGS84.fwd(from_east, from_north, azimuth, meters)
    ring = [(round(float(x), 8), round(float(y), 8)) for x, y in zip(longitude, latitude, strict=True)]
    return [*ring[:-1], ring[0]]

"""CSV: a row per place, for a spreadsheet; each header names its unit."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

from pipeline.outputs.exports.view import Place, RunView
from pipeline.outputs.exports.words import clean, in_video, what_to_do
from pipeline.storage.whole_or_nothing import write_text

#: a spreadsheet takes a text that begins with one of these for a formula
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def write_csv(folder: Path, view: RunView) -> list[str]:
    """Write ``places.csv`` (UTF-8, RFC 4180). What is not known is empty; a column of nothing but that is left out.

    A text that a spreadsheet would take for a formula has an apostrophe before it.
    """
    rows = [_row(place, view) for place in view.places]
    names = list(rows[0]) if rows else list(_row(_NOBODY, view))
    if rows:
        names = [name for name in names if any(row[name] != "" for row in rows)]
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, names, extrasaction="ignore", lineterminator="\r\n")
    writer.writeheader()
    writer.writerows({name: _safe(value) for name, value in row.items()} for row in rows)
    write_text(folder / "places.csv", buffer.getvalue())
    return ["places.csv"]


def _row(place: Place, view: RunView) -> dict[str, Any]:
    utm, error = None if view.redacted else place.utm, place.error
    return {
        "mission": view.mission,
        "rank": place.rank,
        "id": place.id,
        "name": place.name,
        "kind": place.kind,
        "what_to_do": what_to_do(place),
        "decided": clean("; ".join(place.decided)),
        "class": place.class_name,
        "probability_0_to_1": f"{place.probability:.6f}",
        "expected_people": f"{place.expected_people:.3f}",
        "latitude_wgs84_deg": f"{place.latitude_deg:.8f}",
        "longitude_wgs84_deg": f"{place.longitude_deg:.8f}",
        "mgrs_wgs84": place.mgrs,
        "utm_zone": "" if utm is None else f"{utm.zone}{utm.band}",
        "utm_easting_m": "" if utm is None else f"{utm.easting_m:.3f}",
        "utm_northing_m": "" if utm is None else f"{utm.northing_m:.3f}",
        "height_above_wgs84_ellipsoid_m": "" if place.ellipsoidal_m is None else f"{place.ellipsoidal_m:.3f}",
        "height_m": "" if place.height_m is None else f"{place.height_m:.3f}",
        "height_datum": place.height_datum,
        "error_95_semi_major_m": "" if error is None else f"{error.semi_major_m:.3f}",
        "error_95_semi_minor_m": "" if error is None else f"{error.semi_minor_m:.3f}",
        "error_long_axis_from_north_deg": "" if error is None else f"{error.orientation_deg:.1f}",
        "seen_from": place.first_seen,
        "seen_to": place.last_seen,
        "clock": place.clock,
        "looks": place.looks,
        "sightings": place.sightings,
        "streams": "; ".join(place.streams),
        "setups": "; ".join(place.setups),
        "may_be_same_person_as": "; ".join(map(str, place.may_be)),
        "in_video": "; ".join(where for where in map(in_video, place.pictures) if where),
        "redacted": view.redacted,
    }


def _safe(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    text = clean(value)
    return f"'{text}" if text.startswith(_FORMULA) and not _is_number(text) else text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


_NOBODY = Place(
    *(0, 0, "found", "", 0.0, 0.0, 0.0, None, None, "", None, "", "", "", 0, 0, (), (), 0.0, (), ())
)

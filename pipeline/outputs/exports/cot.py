"""Cursor on Target (CoT, version 2.0), what ATAK, WinTAK and TAK servers speak: an event per place.

``ce`` and ``le`` are "the one sigma point for a zero mean normal distribution", metres, and ``hae`` the height above
WGS84's ellipsoid (MITRE, Event-PUBLIC.xsd, "Schema for Cursor-On-Target (CoT) Event data model (Version 2.0)",
approved for public release). The map knows its error along the ground only: ``le`` is 9999999, which says unknown,
and so is ``hae`` where the terrain's datum is not known.
"""

from __future__ import annotations

import hashlib
import math
from datetime import UTC, datetime, timedelta
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from pipeline.fusion.error_ellipse import PROBABILITY, chi_square_2
from pipeline.outputs.exports.markup import add
from pipeline.outputs.exports.view import Place, RunView
from pipeline.outputs.exports.words import COLORS, clean, said_of
from pipeline.storage.whole_or_nothing import write_bytes

UNKNOWN = "9999999.0"
#: a spot on the map, as people set one by hand
TYPE = "b-m-p-s-m"
#: made by a machine, of several sights: fused
HOW = "m-f"
#: an event is to be believed for so long; a place does not go away by itself
STALE = timedelta(hours=24)
#: a drone of our own in the air; where it was is not where it is for long
DRONE_TYPE, DRONE_STALE = "a-f-A-M-H-Q", timedelta(seconds=30)
#: half the diagonal of what positions are rounded to when they are redacted, metres
_REDACTED_CE_M = 800.0


def write_cot(folder: Path, view: RunView) -> list[str]:
    """Write ``cot/place-ID.cot``, an XML file per place, which ATAK imports."""
    (folder / "cot").mkdir(exist_ok=True)
    # places that are gone must not stay; what somebody else has put there does
    for old in (folder / "cot").glob("place-*.cot"):
        old.unlink()
    names = []
    for place in view.places:
        name = f"cot/place-{place.id}.cot"
        write_bytes(folder / name, event_of(place, view))
        names.append(name)
    return names


def event_of(place: Place, view: RunView) -> bytes:
    """The event of a place, UTF-8 XML: of the time ``view.made_at``."""
    event = _event(uid_of(view, place.id), TYPE, view.made_at, view.made_at + STALE)
    hae = UNKNOWN if place.ellipsoidal_m is None else f"{place.ellipsoidal_m:.3f}"
    position = {"lat": f"{place.latitude_deg:.8f}", "lon": f"{place.longitude_deg:.8f}"}
    add(event, "point", **position, hae=hae, ce=f"{ce_m(place):.3f}", le=UNKNOWN)
    detail = add(event, "detail")
    add(detail, "contact", callsign=place.name)
    add(detail, "color", argb=str(_argb(COLORS[place.kind])))
    add(detail, "usericon", iconsetpath=f"COT_MAPPING_SPOTMAP/{TYPE}/{_argb(COLORS[place.kind])}")
    add(detail, "archive")
    said = [clean(view.mission), *(f"{label}: {text}" for label, text in said_of(place, view))]
    add(detail, "remarks", "\n".join(said))
    return ElementTree.tostring(event, encoding="UTF-8", xml_declaration=True)


def events_of(view: RunView) -> dict[str, bytes]:
    """The events of all places, by uid, the most probable first."""
    return {uid_of(view, place.id): event_of(place, view) for place in view.places}


def gone_event(uid: str, at: datetime) -> bytes:
    """What takes the marker of a place from the map that a running mission does not hold any more."""
    event = _event(uid, "t-x-d-d", at, at + timedelta(minutes=1))
    add(event, "point", lat="0.0", lon="0.0", hae=UNKNOWN, ce=UNKNOWN, le=UNKNOWN)
    add(add(event, "detail"), "link", uid=uid, relation="none", type="none")
    return ElementTree.tostring(event, encoding="UTF-8", xml_declaration=True)


def drone_event(view: RunView, stream: str, latitude_deg: float, longitude_deg: float) -> bytes:
    """Where a drone was last known to be. Its height and its error are not told: unknown."""
    at = view.made_at
    event = _event(uid_of(view, f"drone-{stream}"), DRONE_TYPE, at, at + DRONE_STALE, how="m-g")
    position = {"lat": f"{latitude_deg:.8f}", "lon": f"{longitude_deg:.8f}"}
    add(event, "point", **position, hae=UNKNOWN, ce=UNKNOWN, le=UNKNOWN)
    add(add(event, "detail"), "contact", callsign=stream)
    return ElementTree.tostring(event, encoding="UTF-8", xml_declaration=True)


def uid_of(view: RunView, what: int | str) -> str:
    """The same for the same thing of a mission, whenever it is sent. what: the id of a place, or another name."""
    return f"searchlight-{hashlib.sha256(view.mission.encode('utf-8', 'replace')).hexdigest()[:16]}-{what}"


def ce_m(place: Place) -> float:
    """One sigma along the ellipse's long axis, metres: along every other direction it is less."""
    if place.error is None:
        return _REDACTED_CE_M
    return place.error.semi_major_m / math.sqrt(chi_square_2(PROBABILITY))


def _event(uid: str, kind: str, at: datetime, stale: datetime, how: str = HOW) -> Element:
    times = {"time": _time(at), "start": _time(at), "stale": _time(stale)}
    return Element("event", {"version": "2.0", "uid": uid, "type": kind, "how": how, **times})


def _time(at: datetime) -> str:
    utc = at.astimezone(UTC)
    return utc.strftime("%Y-%m-%dT%H:%M:%S.") + f"{utc.microsecond // 1000:03d}Z"


def _argb(rgb: str) -> int:
    """Android's colour: a signed number of 32 bits, opaque."""
    return int(f"FF{rgb}", 16) - (1 << 32)

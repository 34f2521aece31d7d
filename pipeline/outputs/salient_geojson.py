"""The found and the possible places as GeoJSON (RFC 7946)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pipeline.fusion.error_ellipse import PROBABILITY, ErrorEllipse
from pipeline.fusion.salient import SalientLocation
from pipeline.geo.heights import UNKNOWN, Heights
from pipeline.ingest.track import Clock
from pipeline.outputs.partial import Partial
from pipeline.outputs.place_picture import PlacePicture, picture_json
from pipeline.outputs.times import iso_time, zone_name
from pipeline.outputs.truth import TruthMatch
from pipeline.storage.versions import stamp
from pipeline.storage.whole_or_nothing import write_text

# 8 decimals of a degree are about 1 mm
_DEGREE_DECIMALS, _METER_DECIMALS = 8, 3


def write_salient(
    path: Path,
    locations: Sequence[SalientLocation],
    match: TruthMatch | None = None,
    clock: Clock = "utc",
    heights: Heights = UNKNOWN,
    partial: Partial | None = None,
    pictures: Sequence[PlacePicture] = (),
) -> None:
    """Write one point per place, the most probable first: longitude, latitude (WGS84), height above the ellipsoid; none
    if it is not known.

    match: gives the property ``truth_distance_m``, the horizontal distance to the true place, if known. heights: what
    the map's heights, which are in the properties, count from. partial: of a run that ended too early; its sentence is
    the member ``partial`` of the collection. pictures: of the places; the property says where they are.
    """
    distance_m = {} if match is None else match.distance_m
    shown: dict[int, list[dict[str, Any]]] = {}
    for picture in pictures:
        shown.setdefault(picture.place, []).append(picture_json(picture, clock))
    ordered = sorted(locations, key=lambda place: (-place.probability, place.id))
    features = [
        _feature(place, distance_m.get(place.id), clock, heights, shown.get(place.id, []))
        for place in ordered
    ]
    said = {} if partial is None else {"partial": partial.sentence}
    collection = {"type": "FeatureCollection"} | stamp("places") | said | {"features": features}
    write_text(path, json.dumps(collection, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def _feature(
    location: SalientLocation,
    truth_distance_m: float | None,
    clock: Clock,
    heights: Heights,
    pictures: list[dict[str, Any]],
) -> dict[str, Any]:
    longitude, latitude = float(location.longitude_deg), float(location.latitude_deg)
    above = heights.ellipsoidal_m(float(location.height_m), latitude, longitude)
    point = [round(longitude, _DEGREE_DECIMALS), round(latitude, _DEGREE_DECIMALS)]
    point += [] if above is None else [round(above, _METER_DECIMALS)]
    properties: dict[str, Any] = {
        "name": f"Place {location.id}",
        "class": location.class_name,
        "probability": round(float(location.probability), 6),
        **map_probability_json(location),
        "seen_from": iso_time(location.first_seen_ns, clock),
        "seen_to": iso_time(location.last_seen_ns, clock),
        "clock": zone_name(clock),
        "height_m": round(float(location.height_m), _METER_DECIMALS),
        "height_datum": heights.name,
        **support_json(location),
        "error_ellipse": ellipse_json(location.error),
        "spread_m": round(float(location.spread_m), _METER_DECIMALS),
        "cells": int(location.cells),
        "pictures": pictures,
    }
    if truth_distance_m is not None:
        properties["truth_distance_m"] = round(float(truth_distance_m), _METER_DECIMALS)
    return {
        "type": "Feature",
        "id": location.id,
        "geometry": {"type": "Point", "coordinates": point},
        "properties": properties,
    }


def support_json(place: SalientLocation) -> dict[str, Any]:
    """What a place rests on, and how many people it may stand for, as plain values."""
    return {
        "looks": int(place.looks),
        "sightings": len(place.sightings),
        "streams": list(place.streams),
        "setups": list(place.setups),
        "people_at_once": int(place.people),
        "expected_people": round(float(place.expected_people), 3),
        "may_be_same_person_as": list(place.may_be),
    }


def ellipse_json(error: ErrorEllipse) -> dict[str, Any]:
    """The ellipse as plain values; the covariance as east-east, east-north, north-north."""
    (east, both), (_, north) = error.covariance_m2.tolist()
    return {
        "probability": PROBABILITY,
        "semi_major_m": round(error.semi_major_m, _METER_DECIMALS),
        "semi_minor_m": round(error.semi_minor_m, _METER_DECIMALS),
        "orientation_deg": round(error.orientation_deg, 1),
        "covariance_m2": [round(value, 6) for value in (east, both, north)],
    }


def map_probability_json(place: SalientLocation) -> dict[str, float]:
    """What the map's cells say of it; its probability is by its sightings."""
    return {} if place.map_probability is None else {"map_probability": round(place.map_probability, 6)}

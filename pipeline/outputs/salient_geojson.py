"""The found places as GeoJSON (RFC 7946)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pipeline.fusion.error_ellipse import PROBABILITY, ErrorEllipse
from pipeline.fusion.salient import SalientLocation
from pipeline.ingest.track import Clock
from pipeline.outputs.times import iso_time, zone_name
from pipeline.outputs.truth import TruthMatch
from pipeline.storage.versions import stamp
from pipeline.storage.whole_or_nothing import write_text

# 8 decimals of a degree are about 1 mm
_DEGREE_DECIMALS, _METER_DECIMALS = 8, 3


def write_salient(
    path: Path, locations: Sequence[SalientLocation], match: TruthMatch | None = None, clock: Clock = "utc"
) -> None:
    """Write one point per found place: longitude, latitude (WGS84), height (m above the terrain's datum).

    match: gives the property ``truth_distance_m``, the horizontal distance to the true place, if known.
    """
    distance_m = {} if match is None else match.distance_m
    features = [_feature(location, distance_m.get(location.id), clock) for location in locations]
    collection = {"type": "FeatureCollection"} | stamp("places") | {"features": features}
    write_text(path, json.dumps(collection, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def _feature(location: SalientLocation, truth_distance_m: float | None, clock: Clock) -> dict[str, Any]:
    longitude, latitude, height = (
        round(float(location.longitude_deg), _DEGREE_DECIMALS),
        round(float(location.latitude_deg), _DEGREE_DECIMALS),
        round(float(location.height_m), _METER_DECIMALS),
    )
    properties: dict[str, Any] = {
        "class": location.class_name,
        "probability": round(float(location.probability), 6),
        "seen_from": iso_time(location.first_seen_ns, clock),
        "seen_to": iso_time(location.last_seen_ns, clock),
        "clock": zone_name(clock),
        "looks": int(location.looks),
        "error_ellipse": ellipse_json(location.error),
        "spread_m": round(float(location.spread_m), _METER_DECIMALS),
        "cells": int(location.cells),
        "streams": list(location.streams),
    }
    if truth_distance_m is not None:
        properties["truth_distance_m"] = round(float(truth_distance_m), _METER_DECIMALS)
    return {
        "type": "Feature",
        "id": location.id,
        "geometry": {"type": "Point", "coordinates": [longitude, latitude, height]},
        "properties": properties,
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

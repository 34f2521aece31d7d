"""The drones' ways and the ground to be searched as GeoJSON (RFC 7946)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.geo.frame import LocalFrame
from pipeline.geo.search_area import SearchArea
from pipeline.messages import FloatArray
from pipeline.storage.versions import stamp
from pipeline.storage.whole_or_nothing import write_text


def write_tracks(path: Path, tracks: Mapping[str, FloatArray], frame: LocalFrame) -> None:
    """A LineString per drone, WGS84. tracks: stream -> float64 (N, >= 2), ENU metres; one of one point is left out.

    Without heights: the map's count from the terrain's datum, and a way in the air is read from above.
    """
    features = [
        _feature(
            {"type": "LineString", "coordinates": _degrees(track, frame)}, {"name": stream, "stream": stream}
        )
        for stream, track in sorted(tracks.items())
        if len(track) > 1
    ]
    _write(path, "tracks", features)


def write_search_area(path: Path, area: SearchArea | None, frame: LocalFrame) -> None:
    """A Polygon for each part of the mission's search area; no feature where it states none."""
    polygons = () if area is None else area.polygons
    features = [
        _feature(
            {"type": "Polygon", "coordinates": [_closed(r, k, frame) for k, r in enumerate(rings)]},
            {"name": "Search area"},
        )
        for rings in polygons
    ]
    _write(path, "search area", features)


def _closed(ring: FloatArray, number: int, frame: LocalFrame) -> list[list[float]]:
    """The outer ring, number 0, goes round to the left, holes to the right (RFC 7946, 3.1.6)."""
    east, north = ring[:, 0], ring[:, 1]
    left = float(np.sum(east * np.roll(north, -1) - np.roll(east, -1) * north)) > 0.0
    turned = ring if left == (number == 0) else ring[::-1]
    return _degrees(np.concatenate([turned, turned[:1]]), frame)


def _degrees(points: FloatArray, frame: LocalFrame) -> list[list[float]]:
    latitude, longitude = frame.wgs84_from_enu(points[:, 0], points[:, 1])
    return np.stack([np.round(longitude, 8), np.round(latitude, 8)], axis=1).tolist()


def _feature(geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _write(path: Path, kind: str, features: list[dict[str, Any]]) -> None:
    document = {"type": "FeatureCollection"} | stamp(kind) | {"features": features}
    write_text(path, json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n")

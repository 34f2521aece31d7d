"""Where the people really are, if somebody knows, and how the found places compare with it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from pipeline.errors import InputError
from pipeline.fusion.salient import SalientLocation
from pipeline.geo.frame import LocalFrame
from pipeline.messages import FloatArray

#: a found place this near to a person has found the person
MATCH_RADIUS_M = 2.0


@dataclass(frozen=True, eq=False)
class TruePerson:
    """track_enu: float64 (N >= 1, 2), east and north, metres; one row stands still, more walk along them."""

    id: str
    track_enu: FloatArray


@dataclass(frozen=True)
class Found:
    """A found place that has a person. distance_m: horizontal."""

    location: int
    person: str
    distance_m: float


@dataclass(frozen=True)
class TruthMatch:
    """found: one to one. missed: people without a found place. false: found places without a person."""

    found: tuple[Found, ...]
    missed: tuple[str, ...]
    false: tuple[int, ...]

    @property
    def people(self) -> int:
        """How many people there are."""
        return len(self.found) + len(self.missed)

    @property
    def mean_distance_m(self) -> float | None:
        """Mean of the distances; None if nobody was found."""
        return sum(f.distance_m for f in self.found) / len(self.found) if self.found else None

    @property
    def distance_m(self) -> dict[int, float]:
        """Distance by the id of the found place."""
        return {f.location: f.distance_m for f in self.found}


def match_truth(
    locations: Sequence[SalientLocation], truth: Sequence[TruePerson], radius_m: float = MATCH_RADIUS_M
) -> TruthMatch:
    """Match found places and people: as many pairs as possible within radius_m, of least total distance.

    The distance to somebody who walks is that to the nearest point of the whole track, at whatever time.
    """
    distances = np.array(
        [
            [distance_to_track_m(place.position_enu, person.track_enu) for person in truth]
            for place in locations
        ]
    ).reshape(len(locations), len(truth))
    # one pair too far costs more than all near pairs together, so the number of near pairs comes first
    too_far = (min(distances.shape) + 1) * max(radius_m, 1.0)
    rows, columns = linear_sum_assignment(np.where(distances <= radius_m, distances, too_far))
    pairs = [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if distances[r, c] <= radius_m]
    hit_places, hit_people = {r for r, _ in pairs}, {c for _, c in pairs}
    return TruthMatch(
        tuple(Found(locations[r].id, truth[c].id, float(distances[r, c])) for r, c in pairs),
        tuple(person.id for c, person in enumerate(truth) if c not in hit_people),
        tuple(place.id for r, place in enumerate(locations) if r not in hit_places),
    )


def distance_to_track_m(position_enu: FloatArray, track_enu: FloatArray) -> float:
    """Horizontal distance from a position (>= 2,) to a polyline (N, 2), metres."""
    start, step = track_enu[:-1], np.diff(track_enu, axis=0)
    length2 = np.maximum(np.sum(step * step, axis=1), 1e-12)
    along = np.clip(np.sum((position_enu[:2] - start) * step, axis=1) / length2, 0.0, 1.0)
    nearest = np.concatenate([track_enu[:1], start + along[:, None] * step])
    return float(np.min(np.linalg.norm(nearest - position_enu[:2], axis=1)))


def load_truth(path: Path, frame: LocalFrame) -> tuple[TruePerson, ...]:
    """Read a GeoJSON FeatureCollection of Points and LineStrings (WGS84). Raises InputError if it is not one.

    A person's name is the feature's id, or else its property ``id``, or else its number from 1.
    """
    try:
        features = json.loads(path.read_text(encoding="utf-8"))["features"]
        return tuple(_person(path, k, feature, frame) for k, feature in enumerate(features))
    except FileNotFoundError:
        raise InputError(path, "no file", "the true places as GeoJSON") from None
    except (OSError, ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise InputError(path, f"text that cannot be read ({type(error).__name__})", _EXPECTED) from None


_EXPECTED = "a GeoJSON FeatureCollection of Points and LineStrings"


def _person(path: Path, number: int, feature: dict[str, Any], frame: LocalFrame) -> TruePerson:
    geometry, where = feature["geometry"], f"{path} features.{number}.geometry"
    if geometry["type"] not in ("Point", "LineString"):
        raise InputError(where, repr(geometry["type"])[:60], "Point or LineString")
    points = [geometry["coordinates"]] if geometry["type"] == "Point" else geometry["coordinates"]
    degrees = np.array([point[:2] for point in points], dtype=np.float64)
    if not _on_earth(degrees):
        raise InputError(where, f"coordinates {str(points)[:60]}", "longitude and latitude in degrees")
    track = np.stack(frame.enu_from_wgs84(degrees[:, 1], degrees[:, 0]), axis=1)
    properties = feature.get("properties") or {}
    return TruePerson(str(feature.get("id", properties.get("id", number + 1))), track)


def _on_earth(degrees: FloatArray) -> bool:
    return degrees.shape[1:] == (2,) and bool(np.all(np.abs(degrees) <= (180.0, 90.0)))

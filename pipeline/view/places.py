"""The places of a run as they are shown: with what reviewers decided of them, in the map frame."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.geo.frame import LocalFrame
from pipeline.view.decisions import SAME_PLACE_M, Decision, decided_probability, net_votes, votes


@dataclass(frozen=True)
class Place:
    """kind: found or possible, as the run has it. probability: by the run; properties: as in its GeoJSON.
    east_m, north_m: in the map frame. decisions: those that stand, in their order. sightings: see ``sightings``.
    """

    id: int
    kind: str
    class_name: str
    probability: float
    latitude_deg: float
    longitude_deg: float
    east_m: float
    north_m: float
    properties: Mapping[str, Any]
    sightings: Sequence[Mapping[str, Any]] = ()
    decisions: tuple[Decision, ...] = ()

    @property
    def net(self) -> int:
        """Confirmations less rejections."""
        return net_votes(self.decisions)

    @property
    def decided(self) -> float:
        """Its probability with the decisions."""
        return decided_probability(self.probability, self.net)

    @property
    def conflict(self) -> bool:
        """Whether reviewers contradict each other."""
        return len({d.kind for d in votes(self.decisions).values()}) > 1

    @property
    def semi_axes_m(self) -> tuple[float, float, float]:
        """Of the error ellipse, metres, and the direction of the longer one, degrees from north by east."""
        ellipse = self.properties.get("error_ellipse") or {}
        major, minor = float(ellipse.get("semi_major_m", 1.0)), float(ellipse.get("semi_minor_m", 1.0))
        return major, minor, float(ellipse.get("orientation_deg", 0.0))


def places_of(
    found: bytes | None, possible: bytes | None, sightings: bytes | None, frame: LocalFrame
) -> tuple[Place, ...]:
    """Of the files of a run; those found before the possible ones, as they stand there."""
    seen = json.loads(sightings) if sightings else {}
    return tuple(
        _place(feature, kind, seen, frame)
        for kind, data in (("found", found), ("possible", possible))
        for feature in (json.loads(data)["features"] if data else ())
    )


def _place(feature: Mapping[str, Any], kind: str, seen: Mapping[str, Any], frame: LocalFrame) -> Place:
    longitude, latitude = feature["geometry"]["coordinates"][:2]
    east, north = frame.enu_from_wgs84(np.array(latitude), np.array(longitude))
    properties = feature["properties"]
    return Place(
        int(feature["id"]),
        kind,
        str(properties["class"]),
        float(properties["probability"]),
        float(latitude),
        float(longitude),
        float(east),
        float(north),
        properties,
        tuple(seen.get(str(feature["id"]), ())),
    )


def with_decisions(
    places: Sequence[Place], standing: Sequence[Decision], frame: LocalFrame
) -> tuple[tuple[Place, ...], tuple[Decision, ...]]:
    """The places with what was decided of them, and the decisions whose place is not there (any more)."""
    mine: dict[int, list[Decision]] = {place.id: [] for place in places}
    lost = []
    for decision in standing:
        place = _nearest(places, decision, frame)
        if place is None:
            lost.append(decision)
        else:
            mine[place.id].append(decision)
    decided = tuple(Place(**{**vars(p), "decisions": tuple(mine[p.id])}) if mine[p.id] else p for p in places)
    return decided, tuple(lost)


def _nearest(places: Sequence[Place], decision: Decision, frame: LocalFrame) -> Place | None:
    east, north = frame.enu_from_wgs84(np.array(decision.latitude_deg), np.array(decision.longitude_deg))
    alike = [p for p in places if p.class_name == decision.class_name]
    if not alike:
        return None
    distances = np.hypot([p.east_m - float(east) for p in alike], [p.north_m - float(north) for p in alike])
    nearest = int(np.argmin(distances))
    reach = max(SAME_PLACE_M, alike[nearest].semi_axes_m[0])
    return alike[nearest] if distances[nearest] <= reach else None

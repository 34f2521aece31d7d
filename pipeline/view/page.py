"""A run as plain values for the page that shows it, in the metres of the map frame."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pipeline.geo.frame import LocalFrame
from pipeline.messages import FloatArray
from pipeline.outputs.live_names import FOUND, POSSIBLE, REDUCER, STATUS
from pipeline.view.contours import contours
from pipeline.view.decisions import Decision, read_log
from pipeline.view.files import GROUND, MAP, POSES, SIGHTINGS, RunFolder
from pipeline.view.grid import grid
from pipeline.view.ground import Ground
from pipeline.view.layer import Layer, layer_of_tif
from pipeline.view.pictures import with_votes
from pipeline.view.places import Place, places_of, with_decisions
from pipeline.view.poses import Flight, decoded
from pipeline.view.who_saw import footprint, who_saw

#: of one drone, on the page
_MOST_POSES = 600


@dataclass(frozen=True, eq=False)
class RunPage:
    """A run as it was at one moment. Whatever is read is read when it is first needed, and once."""

    folder: RunFolder

    @cached_property
    def ground(self) -> Ground | None:
        """None of a run of a version that did not keep it."""
        data = self.folder.read(GROUND)
        return None if data is None else Ground.decoded(data)

    @cached_property
    def flights(self) -> tuple[Flight, ...]:
        """Empty of a run of a version that did not keep them."""
        data = self.folder.read(POSES)
        return () if data is None else decoded(data)

    @cached_property
    def frame(self) -> LocalFrame:
        """The map frame; of a run that kept no ground, one about its first place."""
        if self.ground is not None:
            return self.ground.frame
        for name in (FOUND, POSSIBLE):
            for feature in json.loads(self.folder.read(name) or b'{"features": []}')["features"]:
                longitude, latitude = feature["geometry"]["coordinates"][:2]
                return LocalFrame(latitude, longitude)
        return LocalFrame(0.0, 0.0)

    @cached_property
    def _decided(self) -> tuple[tuple[Place, ...], tuple[Decision, ...]]:
        read = self.folder.read
        places = places_of(read(FOUND), read(POSSIBLE), read(SIGHTINGS), self.frame)
        return with_decisions(places, read_log(self.folder.run).standing, self.frame)

    @property
    def places(self) -> tuple[Place, ...]:
        """With what was decided of them."""
        return self._decided[0]

    @cached_property
    def layer(self) -> Layer | None:
        """The run's own; None before there is one."""
        if self.folder.state == "flying":
            data = self.folder.read(MAP)
            return None if data is None else Layer.decoded(data)
        path = self.folder.run / "saliency.tif"
        return layer_of_tif(path) if path.is_file() and self.ground is not None else None

    @cached_property
    def decided_layer(self) -> Layer | None:
        """With the decisions."""
        return None if self.layer is None else with_votes(self.layer, self.places)

    def now(self) -> dict[str, Any]:
        """All that may change while somebody looks."""
        log = read_log(self.folder.run)
        places, lost = self._decided
        layer = self.layer
        return {
            "state": self.folder.state,
            "places": [_place(place) for place in places],
            "lost_decisions": [asdict(d) for d in lost],
            "unreadable_decisions": log.unreadable,
            "standing": [asdict(d) for d in log.standing],
            "layer": None if layer is None else _bounds(layer.east_m, layer.north_m, layer.cell_m, layer.pod),
            "run": self._run(),
        }

    def said(self) -> dict[str, Any]:
        """What changes every second of a run that flies, and is small however many places there are."""
        return {"state": self.folder.state, "run": self._run()}

    def _run(self) -> dict[str, Any]:
        """The summary, or while the run flies what reducer and actors say."""
        if self.folder.state == "finished":
            summary = json.loads(self.folder.read("summary.json") or b"{}")
            names = ("mission", "pace", "seconds", "verdict", "streams", "links", "substreams", "timeline")
            said = {name: summary.get(name) for name in (*names, "coverage", "partial", "findings")}
            return said | {
                "places": len(summary.get("found", ())),
                "possible": len(summary.get("possible", ())),
            }
        status = json.loads(self.folder.read(STATUS) or b"{}")
        return {"status": status, "reducer": json.loads(self.folder.read(REDUCER) or b"{}")}

    def flown(self) -> dict[str, Any]:
        """What does not change while a run flies: ground, area, ways, areas for a second look, the grid, contours."""
        ground = self.ground
        bounds = None
        if ground is not None:
            bounds = _bounds(ground.east_m, ground.north_m, ground.cell_m, ground.heights_m)
        return {
            "ground": bounds,
            "grid": [] if bounds is None else grid(self.frame, tuple(bounds)),  # type: ignore[arg-type]
            "contours": [] if ground is None else contours(ground),
            "area": [] if ground is None else [ring.round(2).tolist() for ring in ground.area],
            "flights": [self._flight(flight) for flight in self.flights],
            "second_look": self._second_look(),
        }

    def _flight(self, flight: Flight) -> dict[str, Any]:
        step = max(1, -(-len(flight.times_s) // _MOST_POSES))
        numbers = range(0, len(flight.times_s), step)
        prints: list[Any] = []
        for k in numbers if self.ground is not None else ():
            assert self.ground is not None
            corners = footprint(flight, self.ground, k)
            prints.append(corners.round(1).tolist() if np.isfinite(corners).all() else None)
        return {
            "stream": flight.stream,
            "site": flight.site,
            "start_ms": flight.start_ns // 1_000_000,
            "times_s": [round(float(flight.times_s[k]), 2) for k in numbers],
            "points": [flight.positions[k, :2].round(1).tolist() for k in numbers],
            "footprints": prints,
            "videos": [offset for _, offset in flight.videos],
        }

    def _second_look(self) -> list[Any]:
        data = self.folder.read("second_look.geojson")
        rings = []
        for feature in json.loads(data)["features"] if data else ():
            geometry = feature["geometry"]
            if geometry["type"] == "Polygon":
                rings += geometry["coordinates"]
            elif geometry["type"] == "MultiPolygon":
                rings += [ring for polygon in geometry["coordinates"] for ring in polygon]
        return [self._local(ring) for ring in rings]

    def _local(self, ring: Sequence[Sequence[float]]) -> list[list[float]]:
        points: FloatArray = np.array([p[:2] for p in ring])
        east, north = self.frame.enu_from_wgs84(points[:, 1], points[:, 0])
        return np.stack([east, north], axis=1).round(2).tolist()

    def saw(self, east_m: float, north_m: float) -> dict[str, Any]:
        """Which seconds of which video saw a point; known: whether that can be said."""
        latitude, longitude = self.frame.wgs84_from_enu(np.array(east_m), np.array(north_m))
        seen = [] if self.ground is None else who_saw(self.flights, self.ground, east_m, north_m)
        by_name = {flight.stream: flight for flight in self.flights}
        stretches = []
        for one in seen:
            video = by_name[one.stream].video_at(one.best_s)
            where = {} if video is None else {"video": video[0], "video_s": round(video[1], 2)}
            stretches.append(asdict(one) | where)
        return {
            "latitude_deg": round(float(latitude), 7),
            "longitude_deg": round(float(longitude), 7),
            "known": bool(self.ground is not None and self.flights),
            "seen": stretches,
        }


def _place(place: Place) -> dict[str, Any]:
    major, minor, turn = place.semi_axes_m
    shown = ("seen_from", "seen_to", "clock", "streams", "looks", "sightings", "people_at_once")
    return {
        "id": place.id,
        "kind": place.kind,
        "class": place.class_name,
        "probability": place.probability,
        "decided": round(place.decided, 6),
        "net": place.net,
        "conflict": place.conflict,
        "latitude_deg": place.latitude_deg,
        "longitude_deg": place.longitude_deg,
        "east_m": round(place.east_m, 3),
        "north_m": round(place.north_m, 3),
        "ellipse": [major, minor, turn],
        "said": {name: place.properties.get(name) for name in shown},
        "seen": list(place.sightings),
        "decisions": [asdict(d) for d in place.decisions],
    }


def _bounds(east_m: float, north_m: float, cell_m: float, cells: Any) -> list[float]:
    rows, columns = cells.shape
    return [east_m, north_m, east_m + columns * cell_m, north_m + rows * cell_m]

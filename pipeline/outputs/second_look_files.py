"""The areas worth a second look and the flight over them, as GeoJSON and as a plan for QGroundControl.

For DJI's applications see ``dji_route``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.config.second_look import SecondLook
from pipeline.geo.frame import LocalFrame
from pipeline.geo.heights import UNKNOWN, Heights
from pipeline.messages import FloatArray
from pipeline.second_look.areas import SecondLookArea
from pipeline.second_look.flight import SecondFlight
from pipeline.storage.versions import stamp
from pipeline.storage.whole_or_nothing import write_text

# MAV_CMD, MAV_FRAME, MAV_AUTOPILOT and MAV_TYPE of MAVLink's common message set
_WAYPOINT, _RETURN, _TAKEOFF, _CHANGE_SPEED, _MOUNT_CONTROL = 16, 20, 22, 178, 205
_FRAME_MISSION, _FRAME_RELATIVE = 2, 3
_PX4, _QUADROTOR = 12, 2
#: QGroundControl's altitude mode: above the home position, so that no vertical datum is needed
_RELATIVE_TO_HOME = 1


def write_second_look(path: Path, areas: Sequence[SecondLookArea], frame: LocalFrame) -> None:
    """Write a Polygon per area, or a MultiPolygon, the most worth first (RFC 7946)."""
    _write(path, _collection([_area(area, frame) for area in areas]))


def write_second_flight(
    path: Path, flight: SecondFlight, frame: LocalFrame, heights: Heights = UNKNOWN
) -> None:
    """Write a LineString with heights above the ellipsoid, or none if that is not known; no feature without areas.

    heights: what the map's heights count from.
    """
    points = np.array([flight.home_enu, *(w.position_enu for w in flight.waypoints), flight.home_enu])
    coordinates = [
        _with_height(degrees, height_m, heights)
        for degrees, height_m in zip(_degrees(points[:, :2], frame), points[:, 2].tolist(), strict=True)
    ]
    line = {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": coordinates},
        "properties": {
            "length_m": round(flight.length_m, 1),
            "duration_s": round(flight.duration_s, 1),
            "areas": list(flight.order),
            "height_above_takeoff_m": [round(h - flight.takeoff_m, 2) for h in points[:, 2].tolist()],
            "takeoff_height_m": round(flight.takeoff_m, 2),
            "takeoff_height_datum": heights.name,
            **_checked(flight),
        },
    }
    _write(path, _collection([line] if flight.waypoints else []))


def _with_height(degrees: list[float], height_m: float, heights: Heights) -> list[float]:
    longitude, latitude = degrees
    above = heights.ellipsoidal_m(height_m, latitude, longitude)
    return degrees if above is None else [*degrees, round(above, 2)]


def _checked(flight: SecondFlight) -> dict[str, float]:
    """What the check of the way against the terrain found."""
    if flight.clearance is None:
        return {}
    return {
        "least_height_above_surface_m": round(flight.clearance.least_m, 2),
        "over_unknown_ground_m": round(flight.clearance.unknown_m, 1),
    }


def write_qgc_plan(path: Path, flight: SecondFlight, frame: LocalFrame, params: SecondLook) -> None:
    """Write a QGroundControl plan (format version 1): take-off, speed, camera down, way points, return."""
    _write(path, qgc_plan(flight, frame, params))


def qgc_plan(flight: SecondFlight, frame: LocalFrame, params: SecondLook) -> dict[str, Any]:
    """The plan as plain values.

    Altitudes are metres above the take-off. plannedHomePosition has the take-off's height above the terrain's datum,
    which QGroundControl takes for that above sea level and only shows.
    """
    ((longitude, latitude),) = _degrees(flight.home_enu[None, :2], frame)
    climb_m = flight.climb_m if flight.waypoints else params.height
    commands: list[tuple[int, int, list[float | None]]] = [
        (_TAKEOFF, _FRAME_RELATIVE, [0, 0, 0, None, latitude, longitude, round(climb_m, 2)]),
        (_CHANGE_SPEED, _FRAME_MISSION, [1, params.speed, -1, 0, 0, 0, 0]),
        (_MOUNT_CONTROL, _FRAME_MISSION, [-90, 0, 0, 0, 0, 0, 2]),
    ]
    for waypoint in flight.waypoints:
        ((east, north),) = _degrees(waypoint.position_enu[None, :2], frame)
        above = round(float(waypoint.position_enu[2]) - flight.takeoff_m, 2)
        commands.append((_WAYPOINT, _FRAME_RELATIVE, [waypoint.hover_s, 0, 0, None, north, east, above]))
    commands.append((_RETURN, _FRAME_MISSION, [0, 0, 0, 0, 0, 0, 0]))
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "Searchlight",
        "mission": {
            "version": 2,
            "firmwareType": _PX4,
            "vehicleType": _QUADROTOR,
            "cruiseSpeed": params.speed,
            "hoverSpeed": params.speed,
            "globalPlanAltitudeMode": _RELATIVE_TO_HOME,
            "plannedHomePosition": [latitude, longitude, round(flight.takeoff_m, 2)],
            "items": [_item(k, *command) for k, command in enumerate(commands, start=1)],
        },
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
    }


def _item(number: int, command: int, frame: int, params: list[float | None]) -> dict[str, Any]:
    item: dict[str, Any] = {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": command,
        "doJumpId": number,
        "frame": frame,
        "params": params,
    }
    if frame == _FRAME_RELATIVE:
        item |= {"AMSLAltAboveTerrain": None, "Altitude": params[6], "AltitudeMode": _RELATIVE_TO_HOME}
    return item


def _area(area: SecondLookArea, frame: LocalFrame) -> dict[str, Any]:
    pieces = [[_degrees(ring, frame) for ring in rings] for rings in area.pieces]
    return {
        "type": "Feature",
        "id": area.id,
        "geometry": {"type": "Polygon", "coordinates": pieces[0]}
        if len(pieces) == 1
        else {"type": "MultiPolygon", "coordinates": pieces},
        "properties": {
            "reasons": {name: round(m2, 2) for name, m2 in area.reasons.items()},
            "area_m2": round(area.area_m2, 2),
            "worth": round(area.worth, 6),
        },
    }


def _degrees(points: FloatArray, frame: LocalFrame) -> list[list[float]]:
    """Longitude and latitude of points (N, 2)."""
    latitude, longitude = frame.wgs84_from_enu(points[:, 0], points[:, 1])
    return np.stack([np.round(longitude, 8), np.round(latitude, 8)], axis=1).tolist()


def _collection(features: list[dict[str, Any]]) -> dict[str, Any]:
    return {"type": "FeatureCollection"} | stamp("second look") | {"features": features}


def _write(path: Path, document: dict[str, Any]) -> None:
    write_text(path, json.dumps(document, indent=1, allow_nan=False) + "\n")

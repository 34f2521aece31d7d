"""The second flight as a route for DJI's applications: WPML in a KMZ (DJI Cloud API, "DJI WPML", version 1.0.2).

The archive holds ``wpmz/template.kml``, from which DJI Pilot 2 shows and edits the route, and ``wpmz/waylines.wpml``,
which the aircraft flies. Heights count from the take-off (``relativeToStartPoint``). The aircraft first climbs to the
highest way point of all, then flies straight legs, and goes home; without its remote control it goes back.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from pipeline.config.second_look import DjiModel, SecondLook
from pipeline.geo.frame import LocalFrame
from pipeline.second_look.flight import SecondFlight, Waypoint
from pipeline.storage.whole_or_nothing import write_bytes

_KML, _WPML = "http://www.opengis.net/kml/2.2", "http://www.dji.com/wpmz/1.0.2"
#: droneEnumValue, droneSubEnumValue and payloadEnumValue by model; H20T on the M300, H30T on the M350
MODELS: dict[DjiModel, tuple[int, int, int]] = {
    "M300": (60, 0, 43),
    "M350": (89, 0, 83),
    "M30": (67, 0, 52),
    "M30T": (67, 1, 53),
    "M3E": (77, 0, 66),
    "M3T": (77, 1, 67),
    "M3M": (77, 2, 68),
    "M3D": (91, 0, 80),
    "M3TD": (91, 1, 81),
}
#: takeOffSecurityHeight and globalRTHHeight may be no less, metres
_LEAST_CLIMB_M = 2.0
_STOPPING, _PASSING = "toPointAndStopWithDiscontinuityCurvature", "toPointAndPassWithContinuityCurvature"
#: how far before a way point that is passed its turn may begin, metres; more than 0 for all of them
_TURN_M = 0.2
#: ZIP's oldest date: the same flight gives the same bytes
_DATE = (1980, 1, 1, 0, 0, 0)


def write_dji_route(
    path: Path, flight: SecondFlight, frame: LocalFrame, params: SecondLook, created_ns: int
) -> None:
    """Write the KMZ. flight: with way points. created_ns: what its date is, ns since 1970."""
    created_ms = created_ns // 1_000_000
    files = {
        "wpmz/template.kml": _template(flight, frame, params, created_ms),
        "wpmz/waylines.wpml": _waylines(flight, frame, params),
    }
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), content, zipfile.ZIP_DEFLATED)
    write_bytes(path, buffer.getvalue())


def _template(flight: SecondFlight, frame: LocalFrame, params: SecondLook, created_ms: int) -> bytes:
    root, document = _document()
    _say(document, author="Searchlight", createTime=created_ms, updateTime=created_ms)
    _mission(document, flight, params)
    folder = SubElement(document, _kml("Folder"))
    _say(folder, templateType="waypoint", templateId=0)
    _say(
        SubElement(folder, _wpml("waylineCoordinateSysParam")),
        coordinateMode="WGS84",
        heightMode="relativeToStartPoint",
    )
    _say(folder, autoFlightSpeed=params.speed, globalHeight=_meters(flight.climb_m), gimbalPitchMode="manual")
    _heading(folder, "globalWaypointHeadingParam")
    _say(folder, globalWaypointTurnMode=_PASSING, globalUseStraightLine=1)
    for index, waypoint in enumerate(flight.waypoints):
        mark, height_m = _placemark(folder, index, waypoint, flight, frame)
        _say(
            mark,
            ellipsoidHeight=_meters(height_m),
            height=_meters(height_m),
            useGlobalHeight=0,
            useGlobalSpeed=1,
            useGlobalHeadingParam=1,
            useGlobalTurnParam=0,
        )
        _turn(mark, stops=_stops(flight, index))
        _actions(mark, index, waypoint)
    return _xml(root)


def _waylines(flight: SecondFlight, frame: LocalFrame, params: SecondLook) -> bytes:
    root, document = _document()
    _mission(document, flight, params)
    folder = SubElement(document, _kml("Folder"))
    _say(
        folder,
        templateId=0,
        executeHeightMode="relativeToStartPoint",
        waylineId=0,
        distance=_meters(flight.length_m),
        duration=_meters(flight.duration_s),
        autoFlightSpeed=params.speed,
    )
    for index, waypoint in enumerate(flight.waypoints):
        mark, height_m = _placemark(folder, index, waypoint, flight, frame)
        _say(mark, executeHeight=_meters(height_m), waypointSpeed=params.speed)
        _heading(mark, "waypointHeadingParam")
        _turn(mark, stops=_stops(flight, index))
        _actions(mark, index, waypoint)
    return _xml(root)


def _mission(document: Element, flight: SecondFlight, params: SecondLook) -> None:
    climb_m = _meters(max(flight.climb_m, _LEAST_CLIMB_M))
    drone, sub_type, payload = MODELS[params.dji_model]
    config = SubElement(document, _wpml("missionConfig"))
    _say(
        config,
        flyToWaylineMode="safely",
        finishAction="goHome",
        exitOnRCLost="executeLostAction",
        executeRCLostAction="goBack",
        takeOffSecurityHeight=climb_m,
        globalTransitionalSpeed=params.speed,
        globalRTHHeight=climb_m,
    )
    _say(SubElement(config, _wpml("droneInfo")), droneEnumValue=drone, droneSubEnumValue=sub_type)
    _say(SubElement(config, _wpml("payloadInfo")), payloadEnumValue=payload, payloadPositionIndex=0)


def _placemark(
    folder: Element, index: int, waypoint: Waypoint, flight: SecondFlight, frame: LocalFrame
) -> tuple[Element, float]:
    """A way point's element with its place, and its height above the take-off, metres."""
    east, north, up = waypoint.position_enu.tolist()
    latitude, longitude = frame.wgs84_from_enu(np.array(east), np.array(north))
    mark = SubElement(folder, _kml("Placemark"))
    point = SubElement(SubElement(mark, _kml("Point")), _kml("coordinates"))
    point.text = f"{float(longitude):.8f},{float(latitude):.8f}"
    _say(mark, index=index)
    return mark, up - flight.takeoff_m


def _heading(parent: Element, name: str) -> None:
    """The nose points along the way."""
    _say(
        SubElement(parent, _wpml(name)),
        waypointHeadingMode="followWayline",
        waypointHeadingPathMode="followBadArc",
    )


def _stops(flight: SecondFlight, index: int) -> bool:
    """Whether the aircraft stops at a way point: at both ends, and where it hovers."""
    return index in (0, len(flight.waypoints) - 1) or flight.waypoints[index].hover_s > 0.0


def _turn(mark: Element, *, stops: bool) -> None:
    _say(
        SubElement(mark, _wpml("waypointTurnParam")),
        waypointTurnMode=_STOPPING if stops else _PASSING,
        waypointTurnDampingDist=_TURN_M,
    )
    _say(mark, useStraightLine=1)


def _actions(mark: Element, index: int, waypoint: Waypoint) -> None:
    """Look straight down from the first way point on; hover where that is asked."""
    actions: list[tuple[str, dict[str, object]]] = []
    if index == 0:
        turned = {f"gimbal{axis}Rotate{part}": 0 for axis in ("Roll", "Yaw") for part in ("Enable", "Angle")}
        down = {"gimbalHeadingYawBase": "north", "gimbalRotateMode": "absoluteAngle"}
        pitch = {"gimbalPitchRotateEnable": 1, "gimbalPitchRotateAngle": -90}
        rest = {"gimbalRotateTimeEnable": 0, "gimbalRotateTime": 0, "payloadPositionIndex": 0}
        actions.append(("gimbalRotate", {**down, **pitch, **turned, **rest}))
    if waypoint.hover_s > 0.0:
        # the remote control takes whole seconds
        actions.append(("hover", {"hoverTime": max(round(waypoint.hover_s), 1)}))
    if not actions:
        return
    group = SubElement(mark, _wpml("actionGroup"))
    _say(group, actionGroupId=index, actionGroupStartIndex=index, actionGroupEndIndex=index)
    _say(group, actionGroupMode="sequence")
    _say(SubElement(group, _wpml("actionTrigger")), actionTriggerType="reachPoint")
    for number, (name, values) in enumerate(actions):
        action = SubElement(group, _wpml("action"))
        _say(action, actionId=number, actionActuatorFunc=name)
        _say(SubElement(action, _wpml("actionActuatorFuncParam")), **values)


def _document() -> tuple[Element, Element]:
    root = Element(_kml("kml"))
    return root, SubElement(root, _kml("Document"))


def _say(parent: Element, **values: object) -> None:
    for name, value in values.items():
        SubElement(parent, _wpml(name)).text = f"{value:g}" if isinstance(value, float) else str(value)


def _meters(value: float) -> str:
    return f"{value:.2f}"


def _kml(name: str) -> str:
    return f"{{{_KML}}}{name}"


def _wpml(name: str) -> str:
    return f"{{{_WPML}}}{name}"


def _xml(root: Element) -> bytes:
    ElementTree.register_namespace("", _KML)
    ElementTree.register_namespace("wpml", _WPML)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)

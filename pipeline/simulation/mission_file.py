"""The mission and calibration files of a simulated mission."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from pipeline.config.base import FORMAT_VERSION
from pipeline.config.scenario import Scenario

#: unit of each quantity in a mission file, by its key
_UNITS = {
    "frame_rate": ("hertz", 1.0),
    "max_processing_time": ("seconds", 1.0),
    "time_limit": ("seconds", 1.0),
    "lateness": ("seconds", 1.0),
    "replay": ("seconds", 1.0),
    "bitrates": ("mbps", 1e6),
    "cell_size": ("meters", 1.0),
    "cluster_distance": ("meters", 1.0),
    "width_min": ("meters", 1.0),
    "width_max": ("meters", 1.0),
    "height_min": ("meters", 1.0),
    "height_max": ("meters", 1.0),
    "position_bias": ("meters", 1.0),
    "height_bias": ("meters", 1.0),
    "attitude_bias": ("degrees", math.pi / 180.0),
    "position_noise": ("meters", 1.0),
    "attitude_noise": ("degrees", math.pi / 180.0),
    "correlation_time": ("seconds", 1.0),
    "cause_time": ("seconds", 1.0),
    "widest_look": ("meters", 1.0),
    "box": ("pixels", 1.0),
    "terrain": ("meters", 1.0),
    "body": ("meters", 1.0),
    "resolution_min": ("pixels", 1.0),
    "merge_distance": ("meters", 1.0),
    "height": ("meters", 1.0),
    "ways_width_min": ("meters", 1.0),
    "speed": ("meters_per_second", 1.0),
    "hover": ("seconds", 1.0),
}


def drone_name(number: int) -> str:
    """The stream's id, also the name of its files; number from 0."""
    return f"drone-{number + 1}"


def mission_document(scenario: Scenario, folder: Path) -> dict[str, Any]:
    """What mission.yaml says. folder: where the file will stand; the paths in it are relative to that."""
    part = scenario.mission
    return {
        "version": FORMAT_VERSION,
        "name": scenario.name,
        "terrain": {"file": "terrain.tif", "height_datum": "ellipsoid"},
        "streams": [_stream(drone_name(k)) for k in range(scenario.flight.drones)],
        "inventory": os.path.relpath(part.inventory, folder.resolve()),
        "pool": os.path.relpath(part.pool, folder.resolve()),
        "processing": _with_units(part.processing),
        "fusion": _with_units(part.fusion),
        "truth": "truth/people.geojson",
    }


def calibration_document(scenario: Scenario) -> dict[str, Any]:
    """What camera.yaml says."""
    return scenario.camera.model_dump(mode="json")


def _stream(name: str) -> dict[str, Any]:
    return {
        "id": name,
        "video": f"{name}.mp4",
        "telemetry": {
            "file": f"{name}.srt",
            "format": "dji-srt",
            "height": "absolute",
            "height_datum": "ellipsoid",
            "utc_offset": {"hours": 0},
        },
        "camera": "camera.yaml",
        "site": name,
    }


def _with_units(record: BaseModel) -> dict[str, Any]:
    document: dict[str, Any] = {}
    for key, value in record:
        if isinstance(value, BaseModel):
            document[key] = _with_units(value)
        elif isinstance(value, tuple):
            document[key] = [_quantity(key, item) for item in value]
        else:
            document[key] = _quantity(key, value)
    return document


def _quantity(key: str, value: Any) -> Any:
    if key not in _UNITS:
        return value
    unit, scale = _UNITS[key]
    return {unit: value if math.isinf(value) else value / scale}

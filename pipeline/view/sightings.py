"""Of each place the sightings that are worth looking at: the surest, and those from elsewhere."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.fusion.look import Look
from pipeline.fusion.salient import SalientLocation
from pipeline.geo.camera import Camera

#: of one place
MOST = 4
#: two sightings of one stream are from different directions from this angle on
_ANGLE_RAD = math.radians(40.0)


def chosen(looks: Sequence[Look]) -> list[Look]:
    """At most MOST, the surest first, each from another stream or direction than those before it."""
    picked: list[Look] = []
    for look in sorted(looks, key=lambda k: (-k.score, k.order)):
        if len(picked) < MOST and not any(_alike(look, other) for other in picked):
            picked.append(look)
    return picked


def _alike(one: Look, other: Look) -> bool:
    if one.stream != other.stream:
        return False
    rays = [k.intersection_enu - k.camera_enu for k in (one, other)]
    a, b = (ray / max(float(np.linalg.norm(ray)), 1e-9) for ray in rays)
    return math.acos(float(np.clip(a @ b, -1.0, 1.0))) < _ANGLE_RAD


def sightings_json(
    places: Sequence[SalientLocation], cameras: Mapping[str, Camera], start_ns: Mapping[str, int]
) -> str:
    """By the id of the place; only of this flight's streams. start_ns: of each stream's time 0.

    time_s: of the stream's video. x, y: pixels of the point on the ground in its picture.
    """
    content = {
        str(place.id): [
            _json(look, cameras[look.stream], start_ns[look.stream])
            for look in chosen([k for k in place.sightings if k.stream in start_ns])
        ]
        for place in places
    }
    return json.dumps(content, allow_nan=False) + "\n"


def _json(look: Look, camera: Camera, start_ns: int) -> dict[str, Any]:
    point = (look.intersection_enu - look.camera_enu) @ look.enu_from_camera
    # a zoom moves it along the line to the middle, where the crop is looked for all the same
    x, y = (float(v) for v in camera.project(point[None])[0])
    return {
        "stream": look.stream,
        "time_s": round((look.time_ns - start_ns) * 1e-9, 3),
        "score": round(float(look.score), 4),
        "detector": look.detector,
        "x": round(x, 1) if math.isfinite(x) else None,
        "y": round(y, 1) if math.isfinite(y) else None,
    }

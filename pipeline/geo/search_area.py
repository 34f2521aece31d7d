"""The ground that is to be searched, as a team draws it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.messages import FloatArray


def load_search_area(path: Path, frame: LocalFrame) -> list[FloatArray]:
    """Outer rings (N, 2), east and north, of the Polygons of a GeoJSON file; InputError without one."""
    expected = "GeoJSON with a Polygon or MultiPolygon in degrees"
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        features = document.get("features", [document])
        rings: list[FloatArray] = []
        for feature in features:
            geometry = feature.get("geometry", feature)
            polygons = {"Polygon": [geometry["coordinates"]], "MultiPolygon": geometry["coordinates"]}
            for polygon in polygons.get(geometry["type"], []):
                degrees = np.array([point[:2] for point in polygon[0]], dtype=np.float64)
                if degrees.shape[0] < 4 or np.any(np.abs(degrees) > (180.0, 90.0)):
                    raise InputError(path, "a ring that is no ring of degrees", expected)
                rings.append(np.stack(frame.enu_from_wgs84(degrees[:, 1], degrees[:, 0]), axis=1))
    except FileNotFoundError:
        raise InputError(path, "no file", expected) from None
    except (OSError, ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise InputError(path, f"text that cannot be read ({type(error).__name__})", expected) from None
    if not rings:
        raise InputError(path, "no polygon", expected)
    return rings

"""Whether the focal length that a drone writes holds the digital zoom that it writes beside it: they differ."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

#: a zoom that changes by less is noise of writing it
_CHANGE = math.log(1.01)
#: no drone's lens is wider, millimetres of equivalent focal length (Avata 2: 12 mm)
_WIDEST_MM = 12.0
#: beyond these a value is damaged: millimetres, and times
_FOCAL_MM, _ZOOM = (1.0, 1e5), (0.1, 1e3)


def merge_zoom(fields: Sequence[dict[str, float]]) -> list[str]:
    """Put the digital zoom of samples into their focal lengths, once; what was assumed.

    Without focal lengths the zoom stays in ``digital_zoom``: 1 is the whole picture.
    """
    zooms = [_zoom(f.get("digital_zoom", 1.0)) for f in fields]
    focal_mm = [f.get("focal_length_35mm", math.nan) for f in fields]
    holds, said = True, []
    if not all(abs(zoom - 1.0) < 0.01 for zoom in zooms):
        if not any(math.isfinite(f) for f in focal_mm):
            return ["a digital zoom of 1 is the whole picture, as the camera belongs to it"]
        holds, text = _holds_zoom(focal_mm, zooms)
        said = [text]
    for sample, focal, zoom in zip(fields, focal_mm, zooms, strict=True):
        sample.pop("digital_zoom", None)
        if not holds and math.isfinite(focal):
            sample["focal_length_35mm"] = focal * zoom
    return said


def _holds_zoom(focal_mm: Sequence[float], zooms: Sequence[float]) -> tuple[bool, str]:
    """By how the focal length follows the zoom where that changes, else by how wide a lens that would be."""
    votes = []
    known = [(f, z) for f, z in zip(focal_mm, zooms, strict=True) if _can_be(f, z)]
    for (f, z), (next_f, next_z) in itertools.pairwise(known):
        zoomed = math.log(next_z / z)
        if abs(zoomed) > _CHANGE:
            votes.append(abs(math.log(next_f / f) - zoomed) < 0.5 * abs(zoomed))
    if votes:
        if 2 * sum(votes) >= len(votes):
            return True, "the focal length holds the digital zoom: both change together"
        return False, "the digital zoom is multiplied onto the focal length, which does not follow it"
    widest = min((f / z for f, z in known), default=math.inf)
    if widest <= _WIDEST_MM:
        return False, (
            f"a digital zoom of {max(zooms):g} throughout is multiplied onto the focal length: no lens is as wide as "
            f"{widest:.0f} mm"
        )
    return True, f"the focal length holds the digital zoom of {max(zooms):g} that the file has throughout"


def _can_be(focal_mm: float, zoom: float) -> bool:
    return _FOCAL_MM[0] <= focal_mm <= _FOCAL_MM[1] and _ZOOM[0] <= zoom <= _ZOOM[1]


def _zoom(written: float) -> float:
    """A damaged one counts as none: the position beside it is still good."""
    return written if _ZOOM[0] <= written <= _ZOOM[1] else 1.0

"""The ground of a mission: its surface models, or a plane, as a terrain; and what had to be assumed of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.config.terrain import Datum, FallbackGround
from pipeline.config.terrain import Terrain as TerrainSection
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.geoid import undulation_m
from pipeline.geo.heights import Heights
from pipeline.geo.surface_model import SurfaceModel, bounds_m, center_wgs84, inspect
from pipeline.geo.surfaces import load_mesh, plane
from pipeline.geo.terrain import Terrain, load_terrain
from pipeline.ingest.fallback_ground import takeoff_m, with_fallback
from pipeline.ingest.finding import Finding
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory_of import Ground

#: farther than this from its origin the map frame's scale is off by more than a millimetre in a kilometre, metres
_NEAR_ORIGIN_M = 5000.0
_RASTERS = (".tif", ".tiff", ".vrt", ".hgt", ".dt0", ".dt1", ".dt2", ".img")
#: west, south, east, north, metres
Window = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class GroundModel:
    """datum: of the heights; is_stated: by a file or the mission, else it was assumed. sd_m: of a plane that stands for
    a terrain, else 0. findings: what was assumed.
    """

    terrain: Terrain
    datum: Datum
    sd_m: float
    findings: tuple[Finding, ...]
    is_stated: bool = True

    @property
    def heights(self) -> Heights:
        """What is known of the map's heights."""
        return Heights(self.datum if self.is_stated else None)

    @property
    def ground(self) -> Ground:
        """What heights are told by."""
        terrain = self.terrain
        return Ground(
            self.datum,
            terrain.height,
            undulation_m,
            lambda east, north: terrain.extra_sd_m(*terrain.cell(east, north)),
        )


def frame_over(
    section: TerrainSection, tracks: Sequence[Track], onto: LocalFrame | None = None
) -> LocalFrame:
    """The map frame: its origin is the mesh's, or the middle of the surface model; of the flights if that is far.

    onto: the frame of the map that the flights are added to: it stands in for the flights' middle. Raises InputError
    if they are too far from its origin.
    """
    own = _frame_of_files(section, tracks)
    if own is not None:
        return own
    middle = middle_of(tracks)
    if onto is None:
        return middle
    away_m = math.hypot(
        *(
            float(x)
            for x in onto.enu_from_wgs84(
                np.array(middle.origin_latitude_deg), np.array(middle.origin_longitude_deg)
            )
        )
    )
    if away_m > _NEAR_ORIGIN_M:
        found = f"flights {away_m / 1000.0:,.1f} km from the origin of the map that they are added to"
        raise InputError("--onto", found, f"at most {_NEAR_ORIGIN_M / 1000.0:g} km: a map of their own")
    return onto


def _frame_of_files(section: TerrainSection, tracks: Sequence[Track]) -> LocalFrame | None:
    """The frame that the mesh or the surface model fixes; None if neither does."""
    if section.origin is not None:
        return LocalFrame(math.degrees(section.origin.latitude), math.degrees(section.origin.longitude))
    files = files_of(section)
    if len(files) == 1:
        frame = LocalFrame(*center_wgs84(files[0]))
        edges = bounds_m(files[0], frame)
        if max(abs(edge) for edge in edges) <= _NEAR_ORIGIN_M or not tracks:
            return frame
    return None


def middle_of(tracks: Sequence[Track]) -> LocalFrame:
    """The map frame in the middle of the flights. Raises InputError if they have no position."""
    latitude = np.concatenate([t.latitude_deg for t in tracks])
    longitude = np.concatenate([t.longitude_deg for t in tracks])
    known = np.concatenate([t.has_position for t in tracks])
    if not known.any():
        raise InputError("telemetry", "no position in any of it", "positions, to know where the mission is")
    # the antimeridian may run through the flights
    first = longitude[known][0]
    turned = np.mod(longitude[known] - first + 180.0, 360.0) - 180.0
    east = (first + 0.5 * (turned.min() + turned.max()) + 180.0) % 360.0 - 180.0
    return LocalFrame(float(0.5 * (latitude[known].min() + latitude[known].max())), float(east))


def window_about(tracks: Sequence[Track], frame: LocalFrame, reach_m: float) -> Window | None:
    """The part of the map frame that the flights can see; None without a position."""
    points = [_positions(track, frame) for track in tracks]
    if not sum(len(p) for p in points):
        return None
    every = np.concatenate(points)
    (west, south), (east, north) = every.min(axis=0) - reach_m, every.max(axis=0) + reach_m
    return float(west), float(south), float(east), float(north)


def _positions(track: Track, frame: LocalFrame) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    known = track.has_position
    return np.stack(frame.enu_from_wgs84(track.latitude_deg[known], track.longitude_deg[known]), axis=1)


def load_ground(
    section: TerrainSection,
    cell_m: float,
    frame: LocalFrame,
    window: Window | None,
    tracks: Sequence[Track] = (),
) -> GroundModel:
    """The terrain in cells of a size. window: what of it is needed; all of it if absent.

    tracks: tell the height of a plane that has none. Raises InputError for a file that is no surface model.
    """
    if section.flat is not None:
        return _plane(section, cell_m, frame, window, tracks)
    files = files_of(section)
    if section.origin is not None:
        mesh, stated = load_mesh(files[0], cell_m, frame), section.height_datum is not None
        return GroundModel(mesh, section.height_datum or "ellipsoid", 0.0, (), stated)
    models = [inspect(file, section.unit, section.nodata) for file in files]
    findings = [Finding("assumed", "terrain", str(m.path), note) for m in models for note in m.notes]
    datum = _datum(section, models, findings)
    used = [m for m in models if window is None or _meets(bounds_m(m.path, frame), window)]
    if not used:
        raise InputError(", ".join(map(str, files)), "a surface model far from the flights", "one under them")
    terrain = load_terrain(used, cell_m, frame, window, beyond=section.fallback is not None)
    if section.fallback is not None:
        models_of_it = [inspect(file) for file in files_of(section.fallback)]
        terrain, stood_in = with_fallback(
            terrain, section.fallback, models_of_it, datum, lambda: takeoff_m(tracks)
        )
        findings += stood_in
    stated = section.height_datum is not None or any(m.datum is not None for m in models)
    return GroundModel(terrain, datum, 0.0, tuple(findings), stated)


def files_of(section: TerrainSection | FallbackGround) -> list[Path]:
    """The surface models in their order: the files named, and the rasters of the folders named."""
    files: list[Path] = []
    for path in section.files:
        if not path.is_dir():
            files.append(path)
            continue
        inside = sorted(p for p in path.iterdir() if p.suffix.lower() in _RASTERS)
        if not inside:
            raise InputError(path, "a folder without a raster", f"files that end in {', '.join(_RASTERS)}")
        files += inside
    return files


def _datum(section: TerrainSection, models: Sequence[SurfaceModel], findings: list[Finding]) -> Datum:
    """The mission's word, else the files', else assumed; what contradicts itself is said."""
    said = {m.datum for m in models if m.datum is not None}
    where = ", ".join(str(m.path) for m in models)
    if len(said) > 1:
        raise InputError(where, "surface models above different datums", "tiles of one datum")
    of_files = next(iter(said), None)
    if section.height_datum is None:
        if of_files is None:
            text = "its heights count from the ellipsoid (terrain.height_datum)"
            findings.append(
                Finding("assumed", "datum", where, text, "neither the file nor the mission says it")
            )
        silent = [str(m.path) for m in models if m.datum is None]
        if of_files is not None and silent:
            text = f"its heights count from the {of_files}, as those of its neighbours (terrain.height_datum)"
            evidence = "it does not say its datum; the others do"
            findings.append(Finding("assumed", "datum", ", ".join(silent), text, evidence))
        return of_files or "ellipsoid"
    if of_files is not None and of_files != section.height_datum:
        findings.append(
            Finding(
                "warning",
                "datum",
                where,
                f"its CRS says heights above the {of_files}, the mission above the {section.height_datum}",
                "the vertical part of the CRS",
                f"terrain.height_datum: {of_files}, or none",
            )
        )
    return section.height_datum


def _meets(bounds: Window, window: Window) -> bool:
    return bounds[0] < window[2] and bounds[2] > window[0] and bounds[1] < window[3] and bounds[3] > window[1]


def _plane(
    section: TerrainSection, cell_m: float, frame: LocalFrame, window: Window | None, tracks: Sequence[Track]
) -> GroundModel:
    assert section.flat is not None
    if window is None:
        raise InputError("terrain.flat", "a plane without a flight over it", "telemetry with positions")
    height_m = section.flat.height
    if height_m is None:
        height_m = takeoff_m(tracks)
    text = (
        f"the ground is a plane at {height_m:.1f} m, right to {section.flat.sd:g} m (one standard deviation): "
        "places on slopes and roofs are off by that over the tangent of the view"
    )
    west, south = (math.floor(edge / cell_m) * cell_m for edge in window[:2])
    terrain = plane(frame, west, south, window[2], window[3], cell_m, height_m)
    finding = Finding("warning", "flat_terrain", "terrain.flat", text, "", "terrain.file: a surface model")
    stated = section.height_datum is not None
    return GroundModel(terrain, section.height_datum or "ellipsoid", section.flat.sd, (finding,), stated)

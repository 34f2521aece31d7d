"""What stands for the ground where the surface models know no height: stated, printed, and in the uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pipeline.config.terrain import Datum, FallbackGround
from pipeline.errors import InputError
from pipeline.geo.geoid import undulation_m
from pipeline.geo.raster_content import share_words
from pipeline.geo.surface_model import SurfaceModel, mosaic
from pipeline.geo.terrain import Terrain
from pipeline.ingest.finding import Finding
from pipeline.ingest.track import Track
from pipeline.messages import FloatArray

#: both are compared in cells of this size, metres, and in so many at least
_COMPARED_CELL_M, _LEAST_COMPARED = 10.0, 10
#: a fallback that is farther off, in its own standard deviations, where both know the ground, is said to be off
_MOST_SDS = 2.0
#: of a normal distribution: its standard deviation over its median absolute deviation
_SD_OF_MAD = 1.4826


def with_fallback(
    terrain: Terrain,
    section: FallbackGround,
    models: Sequence[SurfaceModel],
    datum: Datum,
    takeoff: Callable[[], float],
) -> tuple[Terrain, list[Finding]]:
    """The terrain, its unknown cells filled; and what was assumed. models: of the fallback; none for a plane.

    datum: of the terrain. takeoff: the height of a plane that states none. The terrain is left as it is where all of
    it is known, or where the fallback knows nothing either.
    """
    unknown = np.isnan(terrain.heights_m)
    if not unknown.any():
        return terrain, []
    where = ", ".join(str(m.path) for m in models) or "terrain.fallback"
    findings = [Finding("assumed", "terrain", str(m.path), note) for m in models for note in m.notes]
    if models:
        shift_m = _shift_m(terrain, section, models, datum, findings)
        heights = _south_up(terrain, models, terrain.cell_m) + np.float32(shift_m)
        findings += _compared(terrain, section, models, shift_m)
        what = "a coarser model"
    else:
        height_m = takeoff() if section.height is None else section.height
        heights = np.full(terrain.shape, height_m, np.float32)
        what = f"a plane at {height_m:.1f} m"
    stood_in = unknown & np.isfinite(heights)
    if not stood_in.any():
        return terrain, findings
    text = (
        f"{what} stands in for {share_words(float(stood_in.mean()))} of the ground that the flights can see, right to "
        f"{section.sd:g} m (one standard deviation): places there are less sure by that"
    )
    findings.append(
        Finding("assumed", "terrain_fallback", where, text, "the surface model knows no height there")
    )
    filled = np.where(stood_in, heights, terrain.heights_m)
    return replace(
        terrain, heights_m=filled, block_range_m=None, stood_in=stood_in, stood_in_sd_m=section.sd
    ), findings


def takeoff_m(tracks: Sequence[Track]) -> float:
    """Where the absolute and the relative heights of the first flight that has both differ: its take-off."""
    for track in tracks:
        differences = track.absolute_height_m - track.relative_height_m
        if np.isfinite(differences).any():
            return float(np.nanmedian(differences))
    if any(np.isfinite(t.relative_height_m).any() for t in tracks):
        return 0.0
    raise InputError(
        "terrain.flat.height", "nothing, and telemetry with one height only", "the height of the ground"
    )


def _south_up(terrain: Terrain, models: Sequence[SurfaceModel], cell_m: float) -> FloatArray:
    """Heights of models in cells of a size over all of a terrain, row 0 in the south."""
    across = terrain.cell_m / cell_m
    shape = max(1, round(terrain.shape[0] * across)), max(1, round(terrain.shape[1] * across))
    north_m = terrain.north_m + shape[0] * cell_m
    return np.asarray(mosaic(models, terrain.frame, cell_m, terrain.east_m, north_m, shape)[::-1])


def _shift_m(
    terrain: Terrain,
    section: FallbackGround,
    models: Sequence[SurfaceModel],
    datum: Datum,
    findings: list[Finding],
) -> float:
    """What is added to the models' heights to get those above the terrain's datum."""
    where = ", ".join(str(m.path) for m in models)
    said = {m.datum for m in models if m.datum is not None}
    if len(said) > 1 and section.height_datum is None:
        raise InputError(where, "surface models above different datums", "terrain.fallback.height_datum")
    own = section.height_datum or next(iter(said), None)
    if own is None:
        text = f"its heights count from the {datum}, as the terrain's (terrain.fallback.height_datum)"
        findings.append(Finding("assumed", "datum", where, text, "neither the file nor the mission says it"))
    if own in (None, datum):
        return 0.0
    rows, columns = terrain.shape
    middle = terrain.east_m + 0.5 * columns * terrain.cell_m, terrain.north_m + 0.5 * rows * terrain.cell_m
    latitude, longitude = terrain.frame.wgs84_from_enu(np.array(middle[0]), np.array(middle[1]))
    geoid_m, sd_m = undulation_m(float(latitude), float(longitude))
    text = (
        f"its heights above the {own}, the geoid being {geoid_m:.1f} m (sd {sd_m:.1f} m) above the ellipsoid"
    )
    findings.append(Finding("assumed", "datum", where, text, "by a geoid model"))
    return geoid_m if datum == "ellipsoid" else -geoid_m


def _compared(
    terrain: Terrain, section: FallbackGround, models: Sequence[SurfaceModel], shift_m: float
) -> list[Finding]:
    """A warning if the fallback is farther from the surface model than it says, where both know the ground."""
    cell_m = max(terrain.cell_m, _COMPARED_CELL_M)
    coarse = _south_up(terrain, models, cell_m) + shift_m
    rows, columns = np.nonzero(np.isfinite(coarse))
    points = np.stack(
        [terrain.east_m + (columns + 0.5) * cell_m, terrain.north_m + (rows + 0.5) * cell_m], axis=1
    )
    fine = np.array([terrain.height(*point) for point in points.tolist()])
    off_m = (coarse[rows, columns] - fine)[np.isfinite(fine)]
    if len(off_m) < _LEAST_COMPARED:
        return []
    middle_m = float(np.median(off_m))
    scatter_m = _SD_OF_MAD * float(np.median(np.abs(off_m - middle_m)))
    if np.hypot(middle_m, scatter_m) <= _MOST_SDS * section.sd:
        return []
    where = ", ".join(str(m.path) for m in models)
    found = f"it is {middle_m:+.1f} m from the surface model, scattered by {scatter_m:.1f} m"
    evidence = f"{len(off_m)} places that both know; terrain.fallback.sd is {section.sd:g} m"
    mend = "terrain.fallback.height_datum, or a larger terrain.fallback.sd"
    return [Finding("warning", "fallback_off", where, found, evidence, mend)]

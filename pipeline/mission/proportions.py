"""Whether a mission's sizes go together: cells and errors, cells and places."""

from __future__ import annotations

import math

import numpy as np

from pipeline.config.fusion import Fusion, default_cell_m, default_cluster_m
from pipeline.fusion.look_covariance import look_covariances
from pipeline.geo.camera import Camera
from pipeline.geo.terrain import Terrain
from pipeline.ingest.finding import Finding
from pipeline.messages import CameraPose, FloatArray
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.stages.source import StreamInput

#: cells so much smaller than the noise of a look tell nothing more
_TOO_FINE = 4.0
#: cells larger than this hold two people, metres
_TOO_COARSE_M = 2.0
_FARTHEST_M = 3000.0


def check_proportions(prepared: PreparedMission) -> list[Finding]:
    """Warnings where cell size, cluster distance and errors do not go together."""
    fusion, where = prepared.mission.fusion, f"{prepared.path} fusion"
    findings = _of_cells(where, fusion)
    noises = [
        noise
        for stream in prepared.streams
        if (noise := _noise_m(stream, prepared.cameras[stream.stream], prepared.terrain, fusion)) is not None
    ]
    return findings + (_of_noise(where, fusion, max(noises)) if noises else [])


def _of_cells(where: str, fusion: Fusion) -> list[Finding]:
    cell_m, cluster_m, findings = fusion.cell_size, fusion.cluster_distance, []
    if cluster_m < cell_m:
        text = (
            f"cluster_distance {cluster_m:g} m is less than cell_size {cell_m:g} m: cells that touch are one place"
            f" anyway, so people nearer than {2 * cell_m:g} m are one"
        )
        mend = f"cluster_distance: {{meters: {default_cluster_m(cell_m):g}}}, or a smaller cell_size"
        findings.append(Finding("warning", "cluster_distance", where, text, "", mend))
    if cell_m > _TOO_COARSE_M:
        text = f"cells of {cell_m:g} m: people who are nearer to each other are one place"
        findings.append(Finding("warning", "cell_size", where, text, "", _mend(fusion)))
    return findings


def _of_noise(where: str, fusion: Fusion, noise_m: float) -> list[Finding]:
    """noise_m: of a look, one standard deviation in its worst direction."""
    evidence = f"a look at the middle of a picture is off by {noise_m:.2f} m (one standard deviation)"
    if noise_m > fusion.uncertainty.widest_look:
        text = f"places are known to {noise_m:.1f} m only: every box is refused, and nobody can be found"
        mend = "truer errors in fusion.uncertainty, or a larger widest_look"
        return [Finding("warning", "places_too_vague", where, text, evidence, mend)]
    if fusion.update_rule == "paper" and noise_m > 0.5 * fusion.cell_size:
        text = (
            f"under the paper's rule sightings that scatter over cells of {fusion.cell_size:g} m lower each other:"
            " people are lost"
        )
        mend = f"update_rule: with_uncertainty, or cell_size: {{meters: {math.ceil(4 * noise_m) / 2:g}}}"
        return [Finding("warning", "cell_size", where, text, evidence, mend)]
    if fusion.cell_size * _TOO_FINE < noise_m:
        text = f"cells of {fusion.cell_size:g} m are far finer than places are known: they cost time and tell nothing"
        return [Finding("warning", "cell_size", where, text, evidence, _mend(fusion))]
    return []


def _mend(fusion: Fusion) -> str:
    return f"cell_size: {{meters: {default_cell_m(fusion.uncertainty):g}}}, or none: then it follows from the errors"


def _noise_m(stream: StreamInput, camera: Camera, terrain: Terrain, fusion: Fusion) -> float | None:
    """The median over a stream's seconds of what a look is off by its noise, in its worst direction, metres."""
    pixel_rad = 1.0 / math.sqrt(camera.fx * camera.fy)
    noises = []
    for pose, hit in middles(stream, camera, terrain):
        noise, _ = look_covariances(hit[None], pose, fusion.uncertainty, pixel_rad, camera.focal_sd)
        noises.append(math.sqrt(float(np.linalg.eigvalsh(noise[0])[1])))
    return float(np.median(noises)) if noises else None


def middles(stream: StreamInput, camera: Camera, terrain: Terrain) -> list[tuple[CameraPose, FloatArray]]:
    """The camera's poses, once a second, that see ground in the middle of the picture, and where (3,)."""
    middle = np.array([[camera.cx, camera.cy]])
    found = []
    for time_s in stream.seconds_s:
        pose = stream.trajectory.pose(float(time_s))
        if pose is None:
            continue
        hit = terrain.intersect(pose.position_enu, camera.rays_enu(middle, pose)[0], _FARTHEST_M)
        if hit is not None:
            found.append((pose, hit))
    return found

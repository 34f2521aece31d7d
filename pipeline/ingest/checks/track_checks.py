"""What samples alone, beside the video's length and the ground, say about a telemetry."""

from __future__ import annotations

import math

import numpy as np

from pipeline.config.telemetry import Telemetry
from pipeline.geo.camera import Camera
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.ingest.finding import Finding
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory import Trajectory

#: telemetry on the video's clock lasts as long as the video, but for this share and these seconds
_LONGER, _LONGER_S = 1.15, 3.0
#: a gimbal looks no farther down than straight down, degrees
_STEEPEST_DEG = 95.0
#: what films people from the air is no faster over a second, metres per second
_FASTEST_MPS = 70.0
#: take-off lies on the ground within so far of the first sample, and barometers drift so much, metres
_TAKEOFF_REACH_M, _TAKEOFF_SLACK_M = 300.0, 6.0
_FEET = 0.3048


def check_duration(where: str, track: Track, video_s: float) -> list[Finding]:
    """Telemetry on the video's clock that lasts longer than it: another flight's, or another rate of its clock."""
    end_s = float(track.times_s[-1]) if track.end_s is None else track.end_s
    if not track.tied_to_video or end_s <= _LONGER * video_s + _LONGER_S:
        return []
    found = f"telemetry of {end_s:.1f} s beside a video of {video_s:.1f} s, {end_s / video_s:.2f} times its duration"
    mend = "telemetry.file: the one of this video; or both as they were recorded, not cut or slowed down"
    return [Finding("warning", "duration", where, found, "the times of its cues", mend)]


def check_units(where: str, track: Track) -> list[Finding]:
    """Angles that no gimbal has: tenths of degrees, or radians of degrees."""
    pitch_deg = np.degrees(track.pitch_rad)
    share = float(np.mean(np.abs(pitch_deg) > _STEEPEST_DEG)) if np.isfinite(pitch_deg).any() else 0.0
    impossible = track.left_out.get("impossible", 0)
    mostly_left_out = impossible > len(track.times_s)
    if share < 0.2 and not mostly_left_out:
        return []
    found = "angles that no camera has; in tenths of degrees?"
    evidence = (
        f"{share:.0%} of the pitch angles beyond {_STEEPEST_DEG:g} degrees, {impossible} samples impossible"
    )
    return [Finding("warning", "units", where, found, evidence, "telemetry.columns: the unit of each angle")]


def check_speed(where: str, trajectory: Trajectory) -> list[Finding]:
    """Jumps, and speeds that nothing has that films people."""
    times_s, way = trajectory.times_s, trajectory.positions_enu
    if len(times_s) < 3:
        return []
    # over a second or more: positions of few decimals jump between samples
    after = np.searchsorted(times_s, times_s + 1.0)
    known = after < len(times_s)
    first, second = np.flatnonzero(known), after[known]
    if not len(first):
        return []
    speed_mps = np.hypot(*(way[second, :2] - way[first, :2]).T) / (times_s[second] - times_s[first])
    worst = int(np.argmax(speed_mps))
    if speed_mps[worst] <= _FASTEST_MPS:
        return []
    found = f"the drone moves {speed_mps[worst]:.0f} m/s at {times_s[first[worst]]:.1f} s of the video"
    evidence = f"{np.mean(speed_mps > _FASTEST_MPS):.1%} of the flight is faster than {_FASTEST_MPS:g} m/s"
    mend = "telemetry.start, end: cut it out; or check units and order of latitude and longitude"
    return [Finding("warning", "jump", where, found, evidence, mend)]


def check_sky(where: str, trajectory: Trajectory, camera: Camera) -> list[Finding]:
    """A camera whose whole picture lies above the horizon: it searches nothing, or its pitch has the other sign."""
    corners = np.array([[0, 0], [camera.width, 0], [0, camera.height], [camera.width, camera.height]], float)
    rays = camera.rays(corners)
    every = max(1, len(trajectory.times_s) // 500)
    angles = trajectory.angles_rad[::every]
    up = np.array([(rays @ enu_from_camera(*a).T)[:, 2].min() > 0.0 for a in angles.tolist()])
    if up.mean() <= 0.5:
        return []
    found = "the camera looks at the sky"
    pitch_deg = float(np.degrees(np.median(angles[:, 1])))
    evidence = f"{up.mean():.0%} of its poses see no ground; the median pitch is {pitch_deg:+.0f} degrees"
    mend = "a telemetry whose pitch is negative downward"
    return [Finding("warning", "pitch_sign", where, found, evidence, mend)]


def check_takeoff(
    where: str,
    track: Track,
    telemetry: Telemetry,
    trajectory: Trajectory,
    terrain: Terrain,
    undulation_m: float,
) -> list[Finding]:
    """Whether the take-off point, where both heights of a drone differ, lies on the ground near the first sample."""
    if telemetry.height != "absolute" or track.height_is_either:
        return []
    differences = track.absolute_height_m - track.relative_height_m
    if not np.isfinite(differences).any():
        return []
    # the heights of the trajectory are those of the track above the terrain's datum
    lift_m = float(trajectory.positions_enu[0, 2]) - float(
        track.absolute_height_m[np.isfinite(track.absolute_height_m)][0]
    )
    takeoff_m = float(np.nanmedian(differences)) + lift_m
    low_m, high_m = _ground_about(terrain, trajectory)
    if math.isnan(low_m) or low_m - _TAKEOFF_SLACK_M <= takeoff_m <= high_m + _TAKEOFF_SLACK_M:
        return []
    off_m = takeoff_m - (high_m if takeoff_m > high_m else low_m)
    found = f"take-off is {off_m:+.1f} m from the ground about the first sample: heights are off by that"
    evidence = (
        f"absolute minus relative height is {takeoff_m:.1f} m, the ground there {low_m:.1f} to {high_m:.1f} m"
    )
    why = ""
    if abs(abs(off_m) - abs(undulation_m)) < _TAKEOFF_SLACK_M + (high_m - low_m):
        why = f"; the geoid is {undulation_m:+.1f} m above the ellipsoid there, so the datums may be mixed up"
    elif low_m - _TAKEOFF_SLACK_M <= takeoff_m * _FEET <= high_m + _TAKEOFF_SLACK_M:
        why = "; in feet they would be right"
    mend = "telemetry.height_datum, or telemetry.height: relative"
    return [Finding("warning", "height_off", where, found, evidence + why, mend)]


def _ground_about(terrain: Terrain, trajectory: Trajectory) -> tuple[float, float]:
    """Least and greatest height of the ground about the first sample; NaN where nothing is known."""
    east, north = trajectory.positions_enu[0, :2]
    rows, columns = terrain.shape
    reach = math.ceil(_TAKEOFF_REACH_M / terrain.cell_m)
    row, column = (
        int((v - edge) // terrain.cell_m) for v, edge in ((north, terrain.north_m), (east, terrain.east_m))
    )
    step = max(1, reach // 100)
    part = terrain.heights_m[
        max(0, row - reach) : min(rows, row + reach) : step,
        max(0, column - reach) : min(columns, column + reach) : step,
    ]
    if not np.isfinite(part).any():
        return math.nan, math.nan
    return float(np.nanmin(part)), float(np.nanmax(part))

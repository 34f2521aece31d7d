"""Checks of what a mission names: whether its parts fit together."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.config.inventory import Inventory, require_streams
from pipeline.config.mission import Mission, Stream
from pipeline.config.prior import Prior
from pipeline.errors import InputError
from pipeline.geo.search_area import load_search_area
from pipeline.geo.terrain import Terrain
from pipeline.ingest.finding import Finding
from pipeline.ingest.ground import Window
from pipeline.ingest.source import Source
from pipeline.ingest.trajectory import Trajectory
from pipeline.mission.stages.source import StreamInput
from pipeline.second_look.cells import cells_inside
from pipeline.second_look.coverage import EDGE_SHARE
from pipeline.second_look.prior import area_probability

#: of a prior, at least, else it is warned of
_LEAST_ON_MAP = 0.2
#: nobody searches farther than this from where anybody flies, metres
_FAR_M = 20_000.0


def telemetry_covers(stream: Stream, video: Source, trajectory: Trajectory) -> list[Finding]:
    """How much of the video has no pose. Raises InputError if none of it has one."""
    times_s = video.times_s
    missing = int((~trajectory.covers(times_s)).sum())
    if not missing:
        return []
    first_s, last_s = trajectory.span_s
    end_s = float(times_s[-1]) + 1.0 / video.info.frame_rate
    found = f"telemetry from {first_s:.2f} s to {last_s:.2f} s of a video of {end_s:.2f} s"
    if missing == len(times_s):
        expected = f"telemetry for some of {stream.pictures}, or another telemetry.time_offset"
        raise InputError(stream.telemetry.file, found, expected)
    text = f"{missing} of {len(times_s)} pictures have no pose and are not used"
    return [Finding("warning", "no_pose", str(stream.telemetry.file), text, found)]


def terrain_covers(mission: Mission, terrain: Terrain, stream: StreamInput) -> list[Finding]:
    """Whether there is known ground below the drone, once a second.

    Raises InputError if there is none at all, or if the drone is under it most of the time.
    """
    over, unknown, under = 0, [], []
    for time_s in stream.seconds_s:
        pose = stream.trajectory.pose(float(time_s))
        if pose is None:
            continue
        over += 1
        east, north, up = (float(x) for x in pose.position_enu)
        ground = terrain.height(east, north)
        if np.isnan(ground):
            unknown.append(f"at {time_s:.0f} s, east {east:.0f} m, north {north:.0f} m")
        elif up <= ground:
            under.append(f"at {time_s:.0f} s, the drone at {up:.1f} m, ground at {ground:.1f} m")
    name = ", ".join(str(file) for file in mission.terrain.files) or "terrain.flat"
    where = f"{name} under {stream.stream}"
    if over and len(unknown) == over:
        raise InputError(where, f"no ground {unknown[0]}", "a terrain that covers the flight")
    if over and 2 * len(under) > over:
        raise InputError(where, f"the drone below the ground: {under[0]}", "heights above the same datum?")
    findings = []
    if unknown:
        text = f"no ground in {len(unknown)} of {over} seconds; what was seen there is not used"
        findings.append(Finding("warning", "terrain_gap", where, text, f"the first {unknown[0]}"))
    if under:
        text = f"the drone is below the ground in {len(under)} of {over} seconds"
        findings.append(Finding("warning", "height_off", where, text, f"the first {under[0]}"))
    return findings


def require_near(path: Path, area: Window, seen: Window) -> None:
    """Raises InputError for a search area that is farther from all flights than anybody would fly."""
    gap_m = max(seen[0] - area[2], area[0] - seen[2], seen[1] - area[3], area[1] - seen[3])
    if gap_m > _FAR_M:
        found = f"a search area {gap_m / 1000.0:.0f} km from the flights"
        raise InputError(path, found, "one under them: are latitude and longitude exchanged?")


def area_is_on_terrain(path: Path, terrain: Terrain) -> list[Finding]:
    """How much of a search area lies where the ground is not known. Raises InputError if all of it does."""
    area = load_search_area(path, terrain.frame)
    known = cells_inside(area, terrain) & np.isfinite(terrain.heights_m)
    beyond_m2 = area.area_m2 - float(known.sum()) * terrain.cell_m**2
    if not known.any():
        raise InputError(path, "a search area that does not meet the terrain", "one on it")
    findings = [Finding("assumed", "search_area", str(path), note) for note in area.notes]
    if beyond_m2 <= EDGE_SHARE * area.area_m2:
        return findings
    area_m2 = area.area_m2
    text = f"{beyond_m2:,.0f} of {area_m2:,.0f} m2 of the search area lie off the known terrain: nobody looks there"
    return [
        *findings,
        Finding(
            "warning",
            "area_beyond_terrain",
            str(path),
            text,
            "",
            "terrain.file: a surface model of all of it",
        ),
    ]


def prior_is_on_terrain(prior: Prior, terrain: Terrain) -> list[Finding]:
    """How much of a prior lies where nobody can look. Raises InputError if all of it does, or if it is none."""
    on_map = float(area_probability(prior, terrain)[np.isfinite(terrain.heights_m)].sum())
    where = "prior" if prior.file is None else str(prior.file)
    if on_map <= 0.0:
        raise InputError(
            where, "a prior that gives the map nothing", "one of this ground: its position, or its CRS?"
        )
    text = f"the missing person is on this map with {on_map:.0%}, elsewhere with {1.0 - on_map:.0%}"
    if on_map >= _LEAST_ON_MAP:
        return [Finding("assumed", "prior", where, text)]
    return [Finding("warning", "prior_beyond_map", where, text, "", "a larger search_area, or nothing")]


def sites_exist(path: Path, mission: Mission, inventory: Inventory) -> None:
    """Raises InputError unless every stream is filmed at a site of the inventory."""
    sites = {site.id for site in inventory.sites}
    streams = {stream.id for stream in mission.streams}
    for number, stream in enumerate(mission.streams):
        if stream.site not in sites:
            raise InputError(
                f"{path} streams.{number}.site",
                repr(stream.site),
                f"a site of {mission.inventory}: {', '.join(sorted(sites))}",
            )
    require_streams(inventory, mission.inventory, streams, "the mission")

"""What the files of a mission say about each other: all checks, on a mission that was read."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from pipeline.geo.geoid import undulation_m
from pipeline.ingest.checks.bursts import BurstParams
from pipeline.ingest.checks.motion_check import MotionCheckParams, Other, check_motion
from pipeline.ingest.checks.picture_motion import Motion, MotionParams, picture_motion
from pipeline.ingest.checks.predicted_motion import Predictor
from pipeline.ingest.checks.shared_ground import Filmed, SharedGround, check_shared_ground
from pipeline.ingest.checks.track_checks import (
    check_duration,
    check_sky,
    check_speed,
    check_takeoff,
    check_units,
)
from pipeline.ingest.finding import Finding
from pipeline.ingest.track import Track
from pipeline.mission.memory import give_back
from pipeline.mission.near_files import Near, here
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.proportions import check_proportions
from pipeline.mission.stages.source import StreamInput

#: positions in coarser steps than this do not tell how a drone moved within a burst, metres
_COARSEST_M = 0.3
_METERS_PER_DEGREE = 111_320.0
#: samples farther apart than this do not either, seconds
_SLOWEST_S = 2.5


def noticed(prepared: PreparedMission, near: Near = here) -> PreparedMission:
    """The mission, with what the checks found beside what was found in reading it. near: decodes videos where they
    are.
    """
    # of a live stream there are no pictures to compare yet
    of_motion = [] if prepared.mission.is_live else _of_motion(prepared, near)
    found = (*_of_samples(prepared), *of_motion, *check_proportions(prepared))
    return replace(prepared, findings=(*prepared.findings, *found))


def _of_samples(prepared: PreparedMission) -> list[Finding]:
    findings = []
    for stream, config in zip(prepared.streams, prepared.mission.streams, strict=True):
        track, where = prepared.tracks[stream.stream], str(config.telemetry.file)
        if (
            config.end is None and not stream.is_live
        ):  # a part that was asked for is shorter than its telemetry
            findings += check_duration(where, track, stream.end_s)
        findings += check_units(where, track)
        findings += check_speed(where, stream.known_way)
        findings += check_sky(where, stream.known_way, prepared.cameras[stream.stream])
        place = int(np.flatnonzero(track.has_position)[0])
        geoid_m, _ = undulation_m(float(track.latitude_deg[place]), float(track.longitude_deg[place]))
        findings += check_takeoff(where, track, config.telemetry, stream.known_way, prepared.terrain, geoid_m)
    return findings


def _of_motion(prepared: PreparedMission, near: Near) -> list[Finding]:
    """What the pictures' motion says, of streams of which the ground that they share does not say more."""
    params = MotionCheckParams()
    motions = _motions(prepared, near)
    ground = _shared_ground(prepared, motions)
    findings = list(ground.findings)
    for stream, config in zip(prepared.streams, prepared.mission.streams, strict=True):
        where = str(config.telemetry.file)
        if stream.stream in ground.exchanged:
            continue
        if stream.stream not in motions:
            coarse = too_coarse(prepared.tracks[stream.stream])
            findings.append(
                Finding("assumed", "motion_unseen", where, f"its motion was not compared: {coarse}")
            )
            continue
        others = {
            s.stream: Other(
                _predictor(prepared, motions, stream.stream, s),
                _predictor(prepared, motions, s.stream, stream),
            )
            for s in prepared.streams
            if s.stream != stream.stream
            and s.stream in motions
            and frozenset((s.stream, stream.stream)) not in ground.apart
        }
        findings += check_motion(where, _predictor(prepared, motions, stream.stream, stream), others, params)
    return findings


def _shared_ground(prepared: PreparedMission, motions: Mapping[str, Motion]) -> SharedGround:
    filmed = {
        s.stream: Filmed(str(c.telemetry.file), motions[s.stream], s.known_way, prepared.cameras[s.stream])
        for s, c in zip(prepared.streams, prepared.mission.streams, strict=True)
        if s.stream in motions
    }
    return check_shared_ground(filmed, prepared.terrain)


def _predictor(
    prepared: PreparedMission, motions: Mapping[str, Motion], video: str, telemetry: StreamInput
) -> Predictor:
    """Of a stream's video, by a stream's telemetry."""
    return Predictor(motions[video], telemetry.known_way, prepared.cameras[video], prepared.terrain)


def _motions(prepared: PreparedMission, near: Near) -> dict[str, Motion]:
    """The motion in the pictures of each stream whose telemetry it can be compared with; decoded beside each other."""
    streams = [s for s in prepared.streams if not too_coarse(prepared.tracks[s.stream])]
    cores = prepared.mission.processing.decoding_threads or os.cpu_count() or 1
    together = max(1, min(cores, len(streams)))
    bursts = BurstParams()
    params = MotionParams(bursts=replace(bursts, most_pixels=bursts.most_pixels / max(1, len(streams))))

    def motion(stream: StreamInput) -> Motion:
        camera = prepared.cameras[stream.stream]
        size = (camera.width, camera.height)
        threads = max(1, cores // together)
        return near(stream.site, picture_motion, stream.path, stream.end_s, size, params, threads)

    give_back()  # of the telemetry's texts
    with ThreadPoolExecutor(together) as pool:
        motions = dict(zip([s.stream for s in streams], pool.map(motion, streams), strict=True))
    give_back()
    return motions


def too_coarse(track: Track) -> str:
    """Why positions do not tell how a drone moves in a quarter of a second; empty if they do."""
    known = track.has_position
    if known.sum() < 3:
        return "fewer than three samples"
    steps = np.abs(np.diff(np.unique(np.round(track.latitude_deg[known], 10)))) * _METERS_PER_DEGREE
    if len(steps) and float(np.median(steps)) > _COARSEST_M and _is_rounded(track):
        return f"positions in steps of {float(np.median(steps)):.1f} m"
    apart_s = float(np.median(np.diff(track.times_s)))
    return f"a sample each {apart_s:.1f} s" if apart_s > _SLOWEST_S else ""


def _is_rounded(track: Track) -> bool:
    """Whether positions repeat from sample to sample, as those of few decimals do."""
    same = (np.diff(track.latitude_deg) == 0.0) & (np.diff(track.longitude_deg) == 0.0)
    return bool(np.mean(same) > 0.3)

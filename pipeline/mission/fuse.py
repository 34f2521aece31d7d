"""A run without detectors: the map of detections that a team has already."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Literal

import numpy as np

from pipeline.allocation.plan import Assignment, Plan
from pipeline.allocation.problem import Detector, Problem
from pipeline.config.inventory import Inventory
from pipeline.config.mission import Mission, load_mission
from pipeline.config.pool import AccuracyAt, Pool, PoolDetector
from pipeline.errors import InputError
from pipeline.ingest.sampling import sampled_indices
from pipeline.messages import EndOfStream
from pipeline.mission.detection_files import read_listing
from pipeline.mission.faults import Faults
from pipeline.mission.listed_frames import ListedRow, Listing
from pipeline.mission.local import FinishedRun, make_reducer
from pipeline.mission.onto import EarlierRun
from pipeline.mission.own_detections import (
    OWN,
    OwnDetector,
    PlacedDetections,
    looked_at_all,
    place,
)
from pipeline.mission.picture_finder import FilmedStream
from pipeline.mission.prepared import PreparedMission, read_filmed
from pipeline.mission.stages.source import SourceCount

LookedAt = Literal["all", "listed"]


def fuse(
    path: Path,
    detections: Path,
    images: Path | None,
    looked_at: LookedAt | None,
    detector: OwnDetector,
    onto: EarlierRun | None = None,
) -> tuple[PreparedMission, FinishedRun]:
    """The map of a file of detections. path: the mission; its inventory and pool are not read. onto: the run whose map
    goes on.

    looked_at: ``all``: every picture of the images file, or of the processing clock, was looked at; ``listed``:
    those with a row only. Raises InputError for what cannot be used as a whole.
    """
    started = time.monotonic()
    mission = load_mission(path)
    if mission.is_live:
        raise InputError(path, "live streams", "recordings, which detections can be of")
    listing = read_listing(detections, images)
    prepared = _prepared(path, mission, detector, onto)
    filmed = [
        FilmedStream(s.stream, s.path.name, s.source.exact_times_s(), s.known_way, prepared.cameras[s.stream])
        for s in prepared.streams
    ]
    _looked_at(listing, looked_at, detections, prepared, filmed)
    placed = place(listing, filmed, mission.fusion.classes, detector)
    if not placed.detections:
        reasons = (
            ", ".join(f"{reason}: {count}" for reason, count in listing.left_out.items()) or "it is empty"
        )
        raise InputError(
            detections, f"no frame that can be used ({reasons})", "frames of the mission's streams"
        )
    plan = _plan(prepared, detector)
    reducer = make_reducer(
        prepared, plan, lateness=False, relative_accuracy={detector.name: _accuracy(detector)}
    )
    for result in placed.detections:
        reducer.push(result)
    for stream in prepared.streams:
        reducer.push(EndOfStream(stream.stream, OWN))
    reducer.finish()
    counts = {s.stream: _count(s, placed) for s in filmed}
    said = _sentences(detections, listing, placed, detector, looked_at)
    return prepared, FinishedRun(plan, reducer, counts, {}, time.monotonic() - started, "fuse", said)


def _looked_at(
    listing: Listing,
    looked_at: LookedAt | None,
    path: Path,
    prepared: PreparedMission,
    filmed: list[FilmedStream],
) -> None:
    """Nobody but the user knows whether a picture without a result was looked at: it is asked, never guessed."""
    if looked_at is None and listing.pictures:
        found = f"{len(listing.pictures)} images without a result"
        expected = "--looked-at all (nothing was found in them) or --looked-at listed (nobody looked at them)"
        raise InputError(path, found, expected)
    if looked_at == "all":
        if listing.pictures:
            looked_at_all(listing)
            return
        for stream, s in zip(prepared.streams, filmed, strict=True):
            wanted = sampled_indices(
                s.times_s,
                stream.processing_rate_hz,
                1e-3 / stream.video.frame_rate,
                1.0 / stream.video.frame_rate,
            )
            listing.rows += [
                ListedRow(str(path), stream=s.stream, time=repr(float(s.times_s[i]))) for i in wanted
            ]


def _prepared(
    path: Path, mission: Mission, detector: OwnDetector, onto: EarlierRun | None
) -> PreparedMission:
    """What was filmed; in place of inventory and pool what stands for a detector that ran somewhere else."""
    filmed = read_filmed(path, mission, Faults(), onto)
    mission = filmed.mission
    accuracy = _accuracy(detector)
    best = (AccuracyAt.model_construct(bitrate=1.0, accuracy=accuracy),)
    own = PoolDetector.model_construct(id=detector.name, memory=0.0, times=(), accuracy=best)
    pool = Pool.model_construct(detectors=(own,))
    site = "elsewhere"
    problem = Problem(
        streams=tuple(s.stream for s in filmed.streams),
        sites=(site,),
        machines=(),
        detectors=(Detector(OWN, detector.name, site, site, 1, 0.0, (accuracy,), 0.0),),
        bitrates_bps=(1.0,),
        link_bps={},
        frame_rate_hz=mission.processing.frame_rate,
        detectors_per_stream=1,
        detectors_per_frame=1,
        accuracy_weight=mission.processing.accuracy_weight,
    )
    inventory = Inventory.model_construct(sites=(), links=(), assumed=())
    return PreparedMission(
        path,
        mission,
        inventory,
        pool,
        filmed.terrain,
        filmed.cameras,
        filmed.streams,
        problem,
        filmed.findings,
        filmed.left_out,
        heights=filmed.heights,
        onto=onto,
    )


def _plan(prepared: PreparedMission, detector: OwnDetector) -> Plan:
    """Nothing was planned: the one detector looked at each stream, elsewhere."""
    assignments = tuple(
        Assignment(s.stream, OWN, detector.name, "elsewhere", "elsewhere", 1, 0, 1.0)
        for s in prepared.streams
    )
    return Plan("feasible", None, None, None, 1, assignments, 0.0, 0, 0)


def _count(filmed: FilmedStream, placed: PlacedDetections) -> SourceCount:
    """Every picture of the video: listed, or not, or listed in vain."""
    listed = {d.index for d in placed.detections if d.stream == filmed.stream}
    reasons = {i: why for (stream, i), why in placed.not_fused.items() if stream == filmed.stream}
    pictures = range(len(filmed.times_s))
    dropped = {(i, OWN): reasons.get(i, "not_listed") for i in pictures if i not in listed}
    return SourceCount(captured=len(filmed.times_s), due=dict.fromkeys(pictures, (OWN,)), dropped=dropped)


def _accuracy(detector: OwnDetector) -> float:
    return 1.0 if detector.accuracy is None else detector.accuracy


def _sentences(
    path: Path, listing: Listing, placed: PlacedDetections, detector: OwnDetector, looked_at: LookedAt | None
) -> tuple[str, ...]:
    boxes = sum(len(d.scores) for d in placed.detections)
    empty = int(np.sum([not len(d.scores) for d in placed.detections]))
    stated = "stated" if detector.accuracy is not None else "assumed (--accuracy)"
    calibration = (
        "stated"
        if detector.calibration is not None
        else "assumed: a score is the probability that its box is right (--calibration)"
    )
    said = [
        f"detections are from {path}, of the detector {detector.name}: {boxes} boxes in {len(placed.detections)} "
        f"pictures, {empty} of them without a box; pictures that are not listed count as not looked at",
        f"pictures looked at: {'those listed' if looked_at != 'all' else 'all (stated)'}",
        f"accuracy relative to the sensor model's best: {_accuracy(detector):g}, {stated}",
        f"calibration of the scores: {calibration}",
    ]
    if detector.picture_size is None and any(row.box and row.size is None for row in listing.rows):
        said.append("assumed: boxes are in pixels of the video's own pictures (--picture-size)")
    said += [f"assumed: {sentence}" for sentence in dict.fromkeys(listing.assumed)]
    said += [
        f"left out: {count} {reason} (first: {listing.first[reason]})"
        for reason, count in listing.left_out.items()
    ]
    return tuple(said)

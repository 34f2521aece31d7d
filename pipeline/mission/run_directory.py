"""The run directory: everything that a run found, as files."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np

from pipeline.allocation.gantt import gantt
from pipeline.allocation.plan import plan_to_json
from pipeline.fusion.possible import found_and_possible
from pipeline.fusion.salient import SalientLocation
from pipeline.geo.search_area import load_search_area
from pipeline.ingest.checks.box_sizes import check_box_sizes
from pipeline.ingest.finding import Finding
from pipeline.logs import LOG_FILE, Log, keep_log
from pipeline.messages import FloatArray
from pipeline.mission.area_change import with_search_area
from pipeline.mission.disagreeing_streams import check_agreement
from pipeline.mission.found_place_crops import found_place_crops
from pipeline.mission.ledger import contradictions, stream_account, substream_counts
from pipeline.mission.live_files import write_flight
from pipeline.mission.local import FinishedRun
from pipeline.mission.near_files import Near, here
from pipeline.mission.onto import STATE_FILE
from pipeline.mission.people_in_networks import check_networks
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.run_state import save_run_state
from pipeline.outputs.dji_route import write_dji_route
from pipeline.outputs.exports.registry import write_exports
from pipeline.outputs.exports.view import EXPORTS, read_run
from pipeline.outputs.map_picture import map_picture, png, second_look_picture
from pipeline.outputs.partial import Partial
from pipeline.outputs.place_picture import FOLDER as PICTURES
from pipeline.outputs.place_picture import PlacePicture
from pipeline.outputs.remaining_tif import write_remaining
from pipeline.outputs.report import ReportData, write_report
from pipeline.outputs.saliency_tif import write_saliency
from pipeline.outputs.salient_geojson import write_salient
from pipeline.outputs.second_look_files import write_qgc_plan, write_second_flight, write_second_look
from pipeline.outputs.summary import LinkUse, Summary, write_summary
from pipeline.outputs.truth import TruePerson, load_truth, match_truth
from pipeline.outputs.ways_geojson import write_search_area, write_tracks
from pipeline.second_look.plan import SecondLookPlan, plan_second_look
from pipeline.storage.whole_or_nothing import make_folder, run_directory, write_bytes, write_text
from pipeline.view.files import SIGHTINGS
from pipeline.view.sightings import sightings_json

_LOG = Log("outputs")


def write_run_directory(prepared: PreparedMission, run: FinishedRun, out: Path, near: Near = here) -> Summary:
    """Write the run directory, whole or not at all; the summary that was written. near: cuts pictures from videos."""
    if run.search_area is not None:
        prepared = with_search_area(prepared, run.search_area)
    fuser = run.reducer.fuser
    locations, possible = found_and_possible(fuser.maps, fuser.looks, prepared.mission.fusion)
    truth = load_truth(prepared.mission.truth, prepared.frame) if prepared.mission.truth else ()
    schedule = gantt(prepared.problem, run.plan)
    # the first of them flies again
    tracks = {s.stream: _track(prepared, s.stream) for s in prepared.streams}
    if prepared.onto is not None:
        tracks |= prepared.onto.tracks
    crops = found_place_crops(prepared, [*locations, *possible], near)
    mission, camera = prepared.mission, prepared.cameras[prepared.streams[0].stream]
    takeoff_m = prepared.streams[0].trajectory.takeoff_m
    second = plan_second_look(
        fuser.map,
        prepared.terrain,
        mission.fusion,
        camera,
        tracks,
        mission.search_area,
        takeoff_m,
        mission.prior,
    )
    summary = replace(
        _summary(prepared, run, locations, truth),
        possible=possible,
        coverage=second.coverage,
        earlier=() if prepared.onto is None else prepared.onto.flights,
    )
    area = None if mission.search_area is None else load_search_area(mission.search_area, prepared.frame)
    last_ns = max(s.start_ns + round((s.end_s - s.video.start_s) * 1e9) for s in prepared.streams)
    picture = second_look_picture(fuser.map, second.areas, second.flight)
    pictures = [PlacePicture(c.place, c.png, c.sighting.stream, c.sighting.time_ns, c.at) for c in crops]
    report = ReportData(
        summary,
        fuser.map,
        tracks,
        truth,
        schedule,
        pictures,
        second.areas,
        second.flight,
        picture,
        mission.outputs.time_zone,
    )
    with run_directory(out) as folder:
        for name, voxel_map in fuser.maps.items():
            of_class = "" if voxel_map is fuser.map else f"-{name}"
            write_saliency(folder / f"saliency{of_class}.tif", voxel_map, run.partial)
        known = (summary.clock, prepared.heights, run.partial)
        write_salient(folder / "salient.geojson", locations, summary.match, *known, pictures)
        write_salient(folder / "possible.geojson", possible, None, *known, pictures)
        (folder / PICTURES).mkdir()
        for shown in pictures:
            write_bytes(folder / shown.path, shown.png)
        write_tracks(folder / "tracks.geojson", tracks, prepared.frame)
        write_search_area(folder / "search_area.geojson", area, prepared.frame)
        starts = {s.stream: s.start_ns for s in prepared.streams}
        write_text(folder / SIGHTINGS, sightings_json([*locations, *possible], prepared.cameras, starts))
        write_flight(folder, prepared)
        write_text(folder / "plan.json", plan_to_json(run.plan, prepared.problem))
        write_bytes(folder / "map.png", png(map_picture(fuser.map, tracks, locations, truth, possible)))
        write_bytes(folder / "schedule.png", png(schedule))
        _write_second_look(folder, prepared, second, last_ns, run.partial)
        _LOG.event(
            "writing", folder=out, places=len(locations), possible=len(possible), sightings=len(fuser.looks)
        )
        save_run_state(folder / STATE_FILE, prepared, fuser, summary, tracks, crops)
        write_report(folder / "report.html", report)
        write_summary(folder / "summary.json", summary)
        _export(folder, mission.outputs.formats, last_ns)
        _LOG.event("verdict", kind=summary.verdict.kind, sentence=summary.verdict.sentence)
        keep_log(folder / LOG_FILE)
    return summary


def _write_second_look(
    folder: Path, prepared: PreparedMission, second: SecondLookPlan, last_ns: int, partial: Partial | None
) -> None:
    frame, look = prepared.frame, prepared.mission.fusion.second_look
    write_second_look(folder / "second_look.geojson", second.areas, frame)
    write_second_flight(folder / "second_flight.geojson", second.flight, frame, prepared.heights)
    if second.flight.waypoints:
        write_qgc_plan(folder / "second_flight.plan", second.flight, frame, look)
        write_dji_route(folder / "second_flight.kmz", second.flight, frame, look, last_ns)
    if second.remaining is not None:
        write_remaining(folder / "remaining.tif", second.remaining, prepared.terrain, partial)


def _export(folder: Path, formats: Sequence[str], last_ns: int) -> None:
    """What other tools open. A search is not lost because one of these files cannot be made."""
    if not formats:
        return
    try:
        write_exports(
            folder / EXPORTS, read_run(folder, datetime.fromtimestamp(last_ns * 1e-9, UTC)), formats
        )
    except Exception as error:
        _LOG.warning("export_failed", formats=list(formats), error=f"{type(error).__name__}: {error}")
        make_folder(folder / EXPORTS)
        said = f"These formats could not all be written: {', '.join(formats)}.\n{type(error).__name__}: {error}\n"
        write_text(folder / EXPORTS / "FAILED.txt", said)


def _summary(
    prepared: PreparedMission,
    run: FinishedRun,
    locations: tuple[SalientLocation, ...],
    truth: Sequence[TruePerson],
) -> Summary:
    durations = {s.stream: s.end_s - s.video.start_s for s in prepared.streams}
    video_s = max(durations.values())
    return Summary(
        mission=prepared.mission.name,
        mission_file=str(prepared.path),
        pace=run.pace,
        seconds=run.seconds,
        video_seconds=video_s,
        plan=run.plan,
        streams=[stream_account(s.stream, run.counts[s.stream], run.reducer) for s in prepared.streams],
        substreams=substream_counts(run.assignments, run.counts, run.reducer),
        links=[_link(prepared, run, *link, durations[link[0]]) for link in sorted(run.bytes_sent)],
        locations=locations,
        match=match_truth(locations, truth) if truth else None,
        not_taken=run.reducer.not_taken,
        provenance=_provenance(),
        clock=prepared.clock,
        findings=(
            *prepared.findings,
            *run.findings,
            *(f for s, count in run.counts.items() for f in contradictions(s, count, run.reducer)),
            *check_networks(prepared, run.plan),
            *_of_box_sizes(prepared, run),
            *check_agreement(locations, prepared.mission.fusion.uncertainty),
        ),
        left_out=prepared.left_out,
        own_detections=run.own_detections,
        partial=run.partial,
        timeline=run.timeline,
        time_zone=prepared.mission.outputs.time_zone,
    )


def _link(prepared: PreparedMission, run: FinishedRun, stream: str, site: str, duration_s: float) -> LinkUse:
    declared_bps = prepared.problem.link_bps.get((stream, site), 0.0)
    sent = run.bytes_sent[stream, site]
    measured = run.links.get((stream, site))
    if measured is None:
        return LinkUse(stream, site, declared_bps, sent, duration_s)
    return LinkUse(stream, site, declared_bps, sent, duration_s, measured.least_bps, measured.lost)


def _of_box_sizes(prepared: PreparedMission, run: FinishedRun) -> list[Finding]:
    """What the boxes of each stream say about its heights and its camera."""
    findings = []
    for config in prepared.mission.streams:
        sizes = {b: n for (stream, b), n in run.reducer.fuser.sizes.items() if stream == config.id}
        findings += check_box_sizes(str(config.telemetry.file), sizes)
    return findings


def _provenance() -> dict[str, str]:
    names = ("searchlight", "ray", "onnxruntime", "av", "numpy", "ortools")
    return {"python": platform.python_version()} | {name: version(name) for name in names}


def _track(prepared: PreparedMission, stream: str) -> FloatArray:
    """Positions (N, 3) of the camera, twice a second."""
    s = next(s for s in prepared.streams if s.stream == stream)
    times = np.arange(s.video.start_s, s.end_s - 1.0 / s.video.frame_rate, 0.5)
    poses = [pose for t in times if (pose := s.trajectory.pose(float(t))) is not None]
    return np.array([pose.position_enu for pose in poses]).reshape(-1, 3)

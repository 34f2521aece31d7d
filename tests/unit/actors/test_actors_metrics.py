import dataclasses
import math
import urllib.request
from dataclasses import replace
from typing import get_args, get_origin, get_type_hints

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.machine import MachineStatus
from actors.metrics import RunCollector, Snapshot, frame_outcomes, serve
from actors.reducer import ReducerStatus
from actors.source import SourceStatus
from actors.usage import Usage
from pipeline.allocation.plan import Plan
from pipeline.ingest.finding import Finding
from pipeline.link.sender import LinkState
from pipeline.messages import FloatArray
from pipeline.mission.live_files import MapFigures
from pipeline.mission.stages.latency import HOPS, HopHistogram

PLAN = Plan("optimal", 1.25, 1.25, 0.0, 2, (), 0.1, 10, 10)


def source(done: int = 30, sampled: int = 10, dropped: dict[str, int] | None = None) -> SourceStatus:
    return SourceStatus("v", done, 90, False, sampled, dropped or {}, {"ground": 1000}, None)


def reducer(frames: int, dropped: dict[str, int] | None = None) -> ReducerStatus:
    hops = {hop: HopHistogram() for hop in HOPS}
    for histogram in hops.values():
        histogram.observe(0.003)
    return ReducerStatus(
        1,
        {("v", "d"): frames},
        {("v", "d"): 3},
        {("v", "d"): dropped or {}},
        {"v": frames},
        {"v": dropped or {}},
        {"bad_box": 2},
        {("v", "d"): hops},
        {},
        {"wrong_stream": 3},
        None,
    )


@given(
    st.integers(0, 1000), st.integers(0, 300), st.integers(0, 100), st.integers(0, 100), st.integers(0, 100)
)
def test_at_any_moment_captured_is_processed_and_dropped_and_in_flight(
    done: int, sampled: int, at_source: int, processed: int, at_machine: int
) -> None:
    outcomes = frame_outcomes(
        source(done, sampled, {"link_full": at_source}), reducer(processed, {"machine_busy": at_machine})
    )
    assert min(outcomes.values()) >= 0
    answered = processed + at_source + at_machine
    contradiction = outcomes.pop("contradiction")
    assert sum(outcomes.values()) - contradiction == max(done, sampled)
    assert contradiction == max(0, answered - sampled)
    assert contradiction == 0 or outcomes["in_flight"] == 0


def test_the_endpoint_shows_frames_hops_links_and_the_plan() -> None:
    link = LinkState(0.5e6, True, 1.5, 93750, 4, {"ground at 10.0.0.1:7": "silent"})
    idle = LinkState(math.inf, False, 0.0, 0, 0, {})
    machine = MachineStatus("pc", {}, {"not_authentic": 2}, {}, None, idle)
    flying = replace(source(), links={"ground": link})
    snapshot = Snapshot(PLAN, {"v": flying}, reducer(7), {("v", "ground"): 6e6}, machines={"pc": machine})
    server = serve(RunCollector(snapshot), 0)
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{server.server_port}/metrics") as answer:
            text = answer.read().decode()
    finally:
        server.shutdown()
        server.server_close()
    for line in (
        'searchlight_frames_captured_total{stream="v"} 30.0',
        'searchlight_frames_total{outcome="processed",stream="v"} 7.0',
        'searchlight_frames_total{outcome="not_sampled",stream="v"} 20.0',
        'searchlight_frames_in_flight{stream="v"} 3.0',
        'searchlight_link_bytes_total{site="ground",stream="v"} 1000.0',
        'searchlight_link_bandwidth_bps{site="ground",stream="v"} 6e+06',
        'searchlight_hop_seconds_bucket{detector="d",hop="encode",le="0.005",stream="v"} 1.0',
        'searchlight_hop_seconds_count{detector="d",hop="detect",stream="v"} 1.0',
        'searchlight_evidence_not_taken_total{reason="bad_box"} 2.0',
        'searchlight_link_rate_bps{site="ground",stream="v"} 500000.0',
        'searchlight_link_backlog_seconds{site="ground",stream="v"} 1.5',
        'searchlight_link_messages_lost_total{site="ground",stream="v"} 4.0',
        'searchlight_link_down{site="ground",stream="v"} 1.0',
        'searchlight_connections_rejected_total{actor="pc",reason="not_authentic"} 2.0',
        'searchlight_connections_rejected_total{actor="reducer",reason="unknown_key"} 0.0',
        'searchlight_messages_refused_total{actor="reducer",reason="wrong_stream"} 3.0',
        "searchlight_plan_objective 1.25",
        "searchlight_plan_gap 0.0",
    ):
        assert line in text, line


def scraped(snapshot: Snapshot) -> dict[tuple[str, str], float]:
    """Name and reason of each sample of the verdict, and its value."""
    return {
        (sample.name, sample.labels.get("reason", "")): sample.value
        for family in RunCollector(snapshot).collect()
        for sample in family.samples
        if sample.name.startswith("searchlight_verdict")
    }


def test_the_verdict_is_a_gauge_by_reason() -> None:
    trusted = "searchlight_verdict_cannot_be_trusted"
    assert scraped(Snapshot(PLAN)) == {(trusted, ""): 0.0}
    assert scraped(Snapshot(PLAN, {"v": source()}, reducer(7))) == {(trusted, ""): 0.0}
    findings = (
        Finding("warning", "height_off/focal_length", "a.srt", "boxes"),
        Finding("warning", "height_off/focal_length", "b.srt", "boxes"),
        Finding("warning", "terrain_gap", "dem.tif", "a gap, which makes no place wrong"),
        Finding("assumed", "clock_off", "c.srt", "only assumed"),
    )
    refusing = replace(
        reducer(7), detections={("v", "d"): 100}, not_taken={"not the size of its class, or no trust": 80}
    )
    assert scraped(Snapshot(PLAN, {"v": source()}, refusing, findings=findings)) == {
        (trusted, ""): 1.0,
        ("searchlight_verdict_doubts", "height_off_focal_length"): 2.0,
        ("searchlight_verdict_doubts", "boxes_refused_not_the_size_of_its_class_or_no_trust"): 80.0,
    }


def test_nothing_that_metrics_are_made_of_can_hold_a_picture() -> None:
    seen: set[object] = set()

    def walk(hint: object) -> None:
        if hint == FloatArray:  # a drone's way
            return
        assert hint not in (bytes, bytearray, memoryview, np.ndarray)
        if hint in seen:
            return
        seen.add(hint)
        for inner in get_args(hint):
            walk_both(inner)
        if dataclasses.is_dataclass(hint):
            for inner in get_type_hints(hint).values():
                walk_both(inner)

    def walk_both(hint: object) -> None:
        if hint != FloatArray:
            walk(get_origin(hint) or hint)
        walk(hint)

    walk(Snapshot)
    assert {MachineStatus, ReducerStatus, SourceStatus} <= seen


def _value(collector: RunCollector, name: str) -> float:
    return next(s.value for family in collector.collect() for s in family.samples if s.name == name)


def test_what_a_source_sent_that_died_is_added_to_what_its_next_process_sends() -> None:
    collector = RunCollector()
    for sent, pid in ((1000, 7), (4000, 7), (0, 8), (500, 8)):
        sending = replace(source(), bytes_sent={"ground": sent}, pid=pid)
        collector.snapshot = Snapshot(PLAN, {"v": sending}, reducer(7))
    assert _value(collector, "searchlight_link_bytes_total") == 4500


def test_losses_of_actors_are_counted_by_name() -> None:
    collector = RunCollector(Snapshot(PLAN, {"v": source()}, reducer(7), losses={"source:v": 3}))
    samples = [
        s for f in collector.collect() for s in f.samples if s.name == "searchlight_actor_losses_total"
    ]
    assert {s.labels["actor"]: s.value for s in samples} == {"source:v": 3.0, "reducer": 0.0}


def _samples(collector: RunCollector, name: str) -> dict[str, float]:
    """By actor, or by stream."""
    return {
        s.labels.get("actor", s.labels.get("stream", "")): s.value
        for family in collector.collect()
        for s in family.samples
        if s.name == name
    }


def test_who_was_not_heard_for_2_s_is_not_up_and_is_known_to_have_been_seen() -> None:
    now = [1000.0]
    collector = RunCollector(utc=lambda: now[0])
    silent, speaks = replace(source(), usage=Usage(5, 1.0, 999.9)), reducer(7)
    for step in range(4):
        now[0] = 1000.0 + step
        speaks = replace(speaks, usage=Usage(7, 2.0 + step, now[0] - 0.01))
        collector.snapshot = Snapshot(PLAN, {"v": silent}, speaks)
    assert _samples(collector, "searchlight_actor_up") == {"source:v": 0.0, "reducer": 1.0}
    seen = _samples(collector, "searchlight_actor_last_seen_timestamp_seconds")
    assert seen == {"source:v": 1000.0, "reducer": 1003.0}
    assert _samples(collector, "searchlight_actor_memory_bytes") == {"source:v": 5.0, "reducer": 7.0}


def test_processor_time_of_an_actor_goes_on_over_its_processes() -> None:
    collector = RunCollector()
    for seconds, pid in ((3.0, 7), (5.0, 7), (0.5, 8), (2.0, 8)):
        busy = replace(source(), usage=Usage(5, seconds, 0.0), pid=pid)
        collector.snapshot = Snapshot(PLAN, {"v": busy})
    assert _samples(collector, "searchlight_actor_cpu_seconds_total") == {"source:v": 7.0}


@settings(deadline=None)
@given(st.floats(-100.0, 100.0), st.lists(st.floats(0.0, 3.0), min_size=2, max_size=30))
def test_a_clock_is_behind_by_what_it_is_and_at_most_the_quickest_way_more(
    behind_s: float, ways_s: list[float]
) -> None:
    now, collector = [0.0], RunCollector(utc=lambda: now[0])
    for k, way_s in enumerate([9.0, *ways_s]):  # of the first word nobody knows how old it is
        now[0] = 10.0 * k
        said = replace(source(), usage=Usage(5, 1.0, now[0] - way_s - behind_s))
        collector.snapshot = Snapshot(PLAN, {"v": said})
    (found,) = _samples(collector, "searchlight_actor_clock_behind_seconds").values()
    assert behind_s - 1e-6 <= found <= behind_s + min(ways_s) + 1e-6


def test_the_map_has_places_area_and_age_once_they_are_known() -> None:
    names = ("searchlight_places", "searchlight_searched_square_meters", "searchlight_map_age_seconds")
    unknown = RunCollector(Snapshot(PLAN, {"v": source()}, reducer(7)))
    assert [_samples(unknown, name) for name in names] == [{}, {}, {}]
    known = replace(reducer(7), map=MapFigures(3, 5, 120.5), ages_s={"v": 2.5})
    collector = RunCollector(Snapshot(PLAN, {"v": source()}, known))
    assert [_samples(collector, name) for name in names] == [{"": 3.0}, {"": 120.5}, {"v": 2.5}]
    assert _samples(collector, "searchlight_possible_places") == {"": 5.0}


def test_a_stream_says_which_plan_it_follows() -> None:
    collector = RunCollector(Snapshot(PLAN, {"v": replace(source(), epoch=3)}))
    assert _samples(collector, "searchlight_stream_epoch") == {"v": 3.0}

import base64
import dataclasses
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic_search import START_NS, location, standing

from pipeline.geo.grids import mgrs_of
from pipeline.ingest.finding import Finding
from pipeline.ingest.track import Clock
from pipeline.outputs.local_times import LocalTimes
from pipeline.outputs.map_picture import second_look_picture
from pipeline.outputs.place_picture import PlacePicture
from pipeline.outputs.report import ReportData, render_report, write_report
from pipeline.outputs.summary import Latency
from pipeline.outputs.truth import match_truth
from pipeline.outputs.verdict import judge
from pipeline.second_look.areas import SecondLookArea
from pipeline.second_look.coverage import Coverage
from pipeline.second_look.flight import SecondFlight, Waypoint

Search = Callable[..., ReportData]


def test_the_report_needs_nothing_from_outside(search: Search) -> None:
    html = render_report(search())
    assert "default-src 'none'" in html
    sources = re.findall(r'(?:src|href)="([^"]*)"', html)
    assert sources
    assert all(source.startswith(("data:image/png;base64,", "geo:")) for source in sources)
    assert "http://" not in html
    assert "https://" not in html
    assert "<script" not in html


def test_its_pictures_are_pictures(search: Search) -> None:
    pictures = re.findall(r'src="data:image/png;base64,([^"]*)"', render_report(search()))
    assert len(pictures) == 4  # map, schedule, two crops
    assert all(base64.b64decode(picture, validate=True).startswith(b"\x89PNG") for picture in pictures)


def test_text_from_outside_is_escaped(search: Search) -> None:
    html = render_report(search())
    assert "Bear &lt;valley&gt; &amp; creek" in html
    assert "<valley>" not in html


def test_every_place_stream_link_and_reason_is_in_it(search: Search) -> None:
    html = render_report(search())
    for text in (
        "63.39",
        "97.0 %",
        "2026-05-01 12:00:03 CEST",
        "nobody there",
        "half hidden",
        "link full: 5",
        "4.00 Mbps",
        "no limit",
        "48%",
    ):
        assert text in html, text
    assert "2 of 3 people found" in html


def test_without_truth_there_is_no_talk_of_it(search: Search) -> None:
    html = render_report(search(known=False))
    assert "true place" not in html
    assert "nobody there" not in html


def test_a_run_without_a_find_has_a_report(search: Search) -> None:
    html = render_report(search(found=False, known=False))
    assert "No place reached the threshold" in html
    assert "Picture of" not in html


def test_a_run_without_a_plan_has_a_report(search: Search) -> None:
    data = search()
    plan = dataclasses.replace(
        data.summary.plan, status="unknown", objective=None, bound=None, gap=None, assignments=()
    )
    summary = dataclasses.replace(data.summary, plan=plan, links=[], substreams=[])
    assert "Status unknown;" in render_report(dataclasses.replace(data, summary=summary))


def test_the_same_data_gives_the_same_file(search: Search, tmp_path: Path) -> None:
    write_report(tmp_path / "a.html", search())
    write_report(tmp_path / "b.html", search())
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


@pytest.mark.parametrize(
    ("places", "people", "sentence"),
    [
        (1, 1, "1 of 1 person found, 0.00 m from the true place on average; no false place."),
        (2, 1, "1 of 1 person found, 0.00 m from the true place on average; 1 false place."),
        (0, 2, "0 of 2 people found; no false place."),
    ],
)
def test_the_verdict_counts_found_people_and_false_places(places: int, people: int, sentence: str) -> None:
    locations = [location(k, 10.0 * k, 0.0) for k in range(places)]
    truth = [standing(str(k), 10.0 * k, 0.0) for k in range(people)]
    assert judge(locations, match_truth(locations, truth), {}, 0).sentence == sentence


def test_the_verdict_without_truth_claims_no_more_than_it_knows() -> None:
    assert judge([location(1, 0, 0, 0.934)], None, {}, 0).sentence.startswith(
        "1 place where a person is likely; "
    )
    assert "may still hide" in judge([], None, {}, 0).sentence


def test_the_second_look_is_a_section_of_its_own(search: Search) -> None:
    ring = np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 0.0]])
    area = SecondLookArea(1, {"low probability of detection": 12.5}, 12.5, 0.01, (ring,), ring)
    stop = Waypoint(np.array([2.0, 2.0, 135.0]), 4.0, 1)
    flight = SecondFlight((stop,), np.array([0.0, 0.0, 121.0]), 300.0, 120.0, (1,))
    data = search()
    picture = second_look_picture(data.voxel_map, [area], flight)
    html = render_report(replace(data, second_look=[area], second_flight=flight, second_picture=picture))
    for text in ("Worth a second look", "low probability of detection (12)", "300 m long", "2.0 minutes"):
        assert text in html, text
    nothing = SecondFlight((), np.zeros(3), 0.0, 0.0, ())
    complete = Coverage("ways", 100.0, 100.0, 100.0, 300.0)
    summary = replace(data.summary, coverage=complete)
    html = render_report(replace(data, summary=summary, second_flight=nothing, second_picture=picture))
    assert "all of it was seen well, and the map is decided there" in html


@pytest.mark.parametrize(
    "coverage", [Coverage("none", 0.0, 0.0, 0.0, 500.0), Coverage("area", 1600.0, 388.0, 388.0, 500.0)]
)
def test_what_was_not_judged_is_no_success(search: Search, coverage: Coverage) -> None:
    data = search()
    nothing = SecondFlight((), np.zeros(3), 0.0, 0.0, ())
    picture = second_look_picture(data.voxel_map, [], nothing)
    summary = replace(data.summary, coverage=coverage)
    html = render_report(replace(data, summary=summary, second_flight=nothing, second_picture=picture))
    assert "Not judged" in html
    assert "all of it was seen well" not in html
    assert ("decided" in html) == (coverage.basis == "area")


def test_possible_places_have_a_section_and_pictures_of_their_own(search: Search) -> None:
    data = search(known=False)
    possible = location(4, 3.0, 3.0, 0.41)
    summary = replace(data.summary, possible=[possible])
    pictures = [PlacePicture(k, b"png", "drone-1", START_NS) for k in (1, 4)]
    html = render_report(replace(data, summary=summary, pictures=pictures))
    found, _, rest = html.partition("<h2>Possible places")
    assert 'alt="Picture of found place 1"' in found
    assert "41.0 %" in rest
    assert 'alt="Picture of possible place 4"' in rest.partition("<h2>")[0]
    assert "41.0 %" not in html.partition("Possible places")[0]


def test_places_come_by_probability_each_with_what_to_do_and_where(search: Search) -> None:
    data = search()
    locations = tuple(
        replace(place, probability=p)
        for place, p in zip(data.summary.locations, (0.71, 0.99, 0.85), strict=True)
    )
    html = render_report(replace(data, summary=replace(data.summary, locations=locations)))
    cards = html.split('<article class="place">')[1:]
    assert [re.search(r'class="badge">(\d+)<', card).group(1) for card in cards] == ["2", "3", "1"]  # type: ignore[union-attr]
    for card, place in zip(cards, (locations[1], locations[2], locations[0]), strict=True):
        assert "Look at the picture, then send a team." in card
        assert f"<b>{mgrs_of(place.latitude_deg, place.longitude_deg)}</b>" in card
        assert f"{place.latitude_deg:.6f}, {place.longitude_deg:.6f}" in card
    assert "drone-1, DJI_0001.MP4 at 01:05.4, frame 1962" in cards[2]
    assert "2026-05-01 12:00:01 CEST" in cards[2]


def test_the_verdict_has_its_denominator_and_the_limits_come_before_the_rest(search: Search) -> None:
    data = search()
    coverage = Coverage("area", 2000.0, 1600.0, 1500.0, 3000.0, 0.62)
    findings = (Finding("warning", "drone-1.srt", "a gap of 12 s", ""),)
    html = render_report(replace(data, summary=replace(data.summary, coverage=coverage, findings=findings)))
    head = html.partition("<section>")[0]
    assert (
        "Searched: 1,500 of 2,000 square metres of the search area (75.0%); 400 not judged. Of people" in head
    )
    assert "62% would have been detected" in head
    titles = re.findall(r"<h2>(.*?)</h2>", html)
    assert titles[:2] == ["Places, the most probable first", "Map"]
    assert titles.index("What limits this map") < titles.index("Frames: every one accounted for")
    assert "a gap of 12 s" in html


@pytest.mark.parametrize(
    ("coverage", "said"),
    [
        (
            Coverage("none", 0.0, 0.0, 0.0, 3000.0),
            "Cameras saw 3,000 square metres; how much was to be searched",
        ),
        (
            Coverage("ways", 100.0, 100.0, 0.0, 0.0, 0.0),
            "0 of 100 square metres of the ground that the drones flew",
        ),
        (Coverage("area", 100.0, 100.0, 100.4, 900.0, 0.5), "(100.0%). Of people"),
        (Coverage("area", 100.0, 0.0, 0.0, 900.0, None), "(0.0%); 100 not judged."),
    ],
)
def test_the_scope_says_no_more_than_is_known(coverage: Coverage, said: str) -> None:
    assert said in coverage.scope


@pytest.mark.parametrize(
    ("clock", "zone", "shown", "said"),
    [
        ("utc", "Europe/Oslo", "2026-05-01 12:00:00 CEST", "CEST (UTC+02:00), Europe/Oslo, by the mission"),
        ("utc", "America/St_Johns", "2026-05-01 07:30:00 NDT", "NDT (UTC-02:30)"),
        ("local", "Europe/Oslo", "2026-05-01 10:00:00 local time", "as the telemetry has them"),
        ("unknown", None, "2026-05-01 10:00:00 time of the video", "as the telemetry has them"),
    ],
)
def test_times_are_in_the_zone_of_the_mission_or_as_they_are(
    clock: Clock, zone: str | None, shown: str, said: str
) -> None:
    times = LocalTimes(clock, zone)
    assert times(START_NS) == shown
    assert said in times.said(START_NS)


def test_without_a_zone_it_is_the_machines_and_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "Asia/Kathmandu")
    time.tzset()
    try:
        times = LocalTimes()
        assert times(START_NS) == "2026-05-01 15:45:00 +0545"
        assert times.said(START_NS) == "Times are +0545 (UTC+05:45), of the machine that made this report."
    finally:
        monkeypatch.undo()
        time.tzset()


def test_no_column_is_empty(search: Search) -> None:
    data = search()
    summary = data.summary
    links = [replace(link, bandwidth_bps=float("inf")) for link in summary.links]
    substreams = [replace(one, hops={"detect": Latency(0.05, 0.05, 0.1)}) for one in summary.substreams]
    for shown in (summary, replace(summary, links=links, substreams=substreams)):
        html = render_report(replace(data, summary=shown))
        for table in re.findall(r"<table>(.*?)</table>", html, re.S):
            rows = [
                re.findall(r"<td[^>]*>(.*?)</td>", row, re.S)
                for row in re.findall(r"<tr>(.*?)</tr>", table, re.S)
            ]
            rows = [row for row in rows if row]
            assert len({len(row) for row in rows} | {len(re.findall(r"<th[ >]", table))}) == 1
            for column in zip(*rows, strict=True):
                assert any(re.sub(r"<[^>]*>", "", cell).strip() not in ("", "–") for cell in column), table[
                    :300
                ]

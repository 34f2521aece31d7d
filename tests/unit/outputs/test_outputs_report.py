import base64
import dataclasses
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic_search import location, standing

from pipeline.outputs.map_picture import second_look_picture
from pipeline.outputs.report import ReportData, render_report, write_report
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
        "10:00:03",
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
    assert "What the cameras saw" not in html


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
    html = render_report(replace(data, summary=summary, crops=[(1, b"one"), (4, b"four")]))
    section = html.partition("Possible places")[2].partition("What the cameras saw")
    assert "41.0 %" in section[0]
    assert 'alt="Picture of possible place 4"' in section[2]
    assert 'alt="Picture of found place 1"' in section[2]
    assert "41.0 %" not in html.partition("Possible places")[0]

"""What is handed over says what was decided, and undoing a decision gives the same bytes as before it."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

import pytest
from run_folder import write_run

from pipeline.outputs.exports.redaction import redacted
from pipeline.outputs.exports.registry import write_exports
from pipeline.outputs.exports.view import RunView, read_run
from pipeline.view.decided_run import with_decided
from pipeline.view.decisions import append, decided_probability

AT = datetime(2026, 12, 1, 5, 0, tzinfo=UTC)


def view_of(run: Path) -> RunView:
    return with_decided(read_run(run, AT), run)[0]


def decide(run: Path, place: int, kind: str, who: str = "Ana", **more: object) -> int:
    one = next(p for p in read_run(run, AT).places if p.id == place)
    said = {"who": who, "kind": kind, "place": place, "class_name": one.class_name,
            "latitude_deg": one.latitude_deg, "longitude_deg": one.longitude_deg}  # fmt: skip
    return append(run, "2026-12-01T05:00:00Z", said | more).number


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return write_run(tmp_path / "run")


def test_a_rejected_place_is_less_probable_and_no_team_is_sent_for_it(run: Path) -> None:
    before = {p.id: p for p in view_of(run).places}
    decide(run, 2, "reject", text="a rock")
    after = {p.id: p for p in view_of(run).places}
    assert after[2].probability == pytest.approx(decided_probability(before[2].probability, -1))
    assert "rejected" in after[2].name
    assert after[2].decided == ("rejected by Ana, 2026-12-01T05:00:00Z: a rock",)
    assert [p.rank for p in view_of(run).places] == [1, 2, 3, 4, 5]
    assert view_of(run).found[-1].id == 2
    assert {i: p.probability for i, p in after.items() if i != 2} == {
        i: p.probability for i, p in before.items() if i != 2
    }


def test_every_text_format_says_it(run: Path, tmp_path: Path) -> None:
    decide(run, 2, "reject")
    for name in write_exports(
        tmp_path / "out", view_of(run), ("geojson", "csv", "kml", "gpx", "caltopo", "cot")
    ):
        if name.startswith("cot/") and not name.endswith("-2.cot"):  # a file for each place
            continue
        assert "ejected" in (tmp_path / "out" / name).read_text(encoding="utf-8"), name


def test_undone_the_files_are_the_same_bytes(run: Path, tmp_path: Path) -> None:
    before = view_of(run)
    number = decide(run, 1, "confirm")
    assert view_of(run).places != before.places
    decide(run, 1, "undo", undoes=number)
    for folder, view in (("a", before), ("b", view_of(run))):
        write_exports(tmp_path / folder, view, ("geojson", "csv", "kml"))
    names = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert all((tmp_path / "a" / n).read_bytes() == (tmp_path / "b" / n).read_bytes() for n in names)


def test_reviewers_who_contradict_each_other_are_said(run: Path) -> None:
    decide(run, 1, "confirm", "Ana")
    decide(run, 1, "reject", "Bo")
    one = next(p for p in view_of(run).places if p.id == 1)
    assert one.state == "contradicted"
    assert len(one.decided) == 2


def test_a_decision_whose_place_is_gone_is_said(run: Path) -> None:
    said = {
        "who": "Ana",
        "kind": "confirm",
        "place": 9,
        "class_name": "person",
        "latitude_deg": 1.0,
        "longitude_deg": 2.0,
    }
    append(run, "2026-12-01T05:00:00Z", said)
    _, lost = with_decided(read_run(run, AT), run)
    assert len(lost) == 1
    assert "1.000000, 2.000000" in lost[0]


def test_what_leaves_the_team_names_no_reviewer(run: Path, tmp_path: Path) -> None:
    decide(run, 1, "confirm", "Ana Example")
    for name in write_exports(tmp_path / "out", redacted(view_of(run)), ("geojson", "csv", "kml")):
        text = (tmp_path / "out" / name).read_text(encoding="utf-8")
        assert "Ana" not in text
        assert "onfirmed" in text
    assert (
        json.loads((tmp_path / "out/places.geojson").read_text())
        if (tmp_path / "out/places.geojson").exists()
        else True
    )

"""What is handed over says what was decided, and undoing a decision gives the same bytes as before it."""

from __future__ import annotations

import json
import shutil
import zipfile
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.warp import transform
from run_folder import write_run

from pipeline.outputs.exports.decided_cells import Shift, decided_cells
from pipeline.outputs.exports.overlay import overlay_of
from pipeline.outputs.exports.redaction import redacted
from pipeline.outputs.exports.registry import write_exports
from pipeline.outputs.exports.view import RunView, read_run
from pipeline.view.decided_run import with_decided
from pipeline.view.decisions import WEIGHT, append, decided_probability

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


def bands(path: Path) -> dict[str, np.ndarray]:
    with rasterio.open(path) as file:
        return dict(zip(file.descriptions, file.read(), strict=True))


def test_the_map_that_is_handed_over_is_the_one_that_reviewers_have_left(run: Path, tmp_path: Path) -> None:
    decide(run, 2, "reject")
    decide(run, 1, "confirm", "Ana")
    decide(run, 1, "confirm", "Bo")
    view = view_of(run)
    write_exports(tmp_path / "out", view, ("cog",))
    before, after = bands(run / "saliency.tif"), bands(tmp_path / "out/saliency.cog.tif")
    change = after["log_odds"] - before["log_odds"]
    assert sorted({round(float(c), 4) for c in change[np.isfinite(change)]}) == pytest.approx(
        [-WEIGHT, 0.0, 2.0 * WEIGHT], abs=1e-3
    )
    with rasterio.open(run / "saliency.tif") as file:
        for place, net in ((1, 2), (2, -1), (3, 0)):
            one = next(p for p in view.places if p.id == place)
            (east,), (north,) = transform("EPSG:4326", file.crs, [one.longitude_deg], [one.latitude_deg])
            row, column = file.index(east, north)
            assert change[row, column] == pytest.approx(net * WEIGHT, abs=1e-3)
            assert after["probability"][row, column] == pytest.approx(
                decided_probability(float(before["probability"][row, column]), net), abs=1e-5
            )
            assert one.error is not None
            assert np.count_nonzero(np.isclose(change, net * WEIGHT, atol=1e-3)) >= 1
    looked = before["observations"] > 0
    assert np.array_equal(np.isnan(after["probability"]), np.isnan(before["probability"]))
    assert np.array_equal(before["pod"][looked], after["pod"][looked])


def test_undone_the_map_is_the_same_bytes_and_what_is_laid_over_a_map_is_too(
    run: Path, tmp_path: Path
) -> None:
    write_exports(tmp_path / "a", view_of(run), ("cog",))
    plain = overlay_of(run / "saliency.tif")
    number = decide(run, 1, "reject")
    write_exports(tmp_path / "b", view_of(run), ("cog",))
    assert overlay_of(run / "saliency.tif", view_of(run).shifts).png != plain.png
    decide(run, 1, "undo", undoes=number)
    write_exports(tmp_path / "c", view_of(run), ("cog",))
    a, b, c = ((tmp_path / name / "saliency.cog.tif").read_bytes() for name in "abc")
    assert a == c != b
    assert overlay_of(run / "saliency.tif", view_of(run).shifts).png == plain.png


def test_a_place_at_the_map_s_edge_shifts_what_there_is_of_it(run: Path) -> None:
    with rasterio.open(run / "saliency.tif") as file:
        (longitude,), (latitude,) = transform(file.crs, "EPSG:4326", [file.bounds.left], [file.bounds.top])
        before = file.read(2)
        _, after = decided_cells(file, [Shift("person", latitude, longitude, 3.0, 2.0, 30.0, 1.0)])
        _, beyond = decided_cells(file, [Shift("person", latitude + 1.0, longitude, 3.0, 2.0, 30.0, 1.0)])
    assert after.shape == before.shape
    np.testing.assert_array_equal(beyond, before)


def test_every_class_has_its_layer_and_a_decision_shifts_that_of_its_class(run: Path, tmp_path: Path) -> None:
    shutil.copy(run / "saliency.tif", run / "saliency-boat.tif")
    decide(run, 2, "reject")
    view = view_of(run)
    written = write_exports(tmp_path / "out", view, ("cog", "kmz"))
    assert {"saliency.cog.tif", "saliency-boat.cog.tif", "places.kmz"} <= set(written)
    before = bands(run / "saliency.tif")["log_odds"]
    for name, is_shifted in (("saliency", True), ("saliency-boat", False)):
        after = bands(tmp_path / f"out/{name}.cog.tif")["log_odds"]
        assert np.array_equal(before, after, equal_nan=True) != is_shifted, name
    with zipfile.ZipFile(tmp_path / "out/places.kmz") as archive:
        assert {"files/probability.png", "files/probability-boat.png"} <= set(archive.namelist())
        assert b"<visibility>0</visibility>" in archive.read("doc.kml")

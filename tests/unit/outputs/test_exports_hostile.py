"""Names with markup, files that reach out, and what is no run at all."""

from __future__ import annotations

import csv
import dataclasses
import json
import shutil
from datetime import UTC, datetime
from pathlib import Path

import pypdf
import pytest
from lxml import etree
from run_folder import write_run

from pipeline.errors import InputError
from pipeline.outputs.exports.registry import FORMATS, formats_of, write_exports
from pipeline.outputs.exports.view import read_run

AT = datetime(2026, 5, 1, 12, tzinfo=UTC)
NAMES = [
    "<script>alert(1)</script>",
    "</name></Document><![CDATA[ &amp; ]]> --><b onload='x'>",
    '=HYPERLINK("x")\x00\x1b[31m\ud800 \u202ełódź 捜索',
    "../../etc/passwd",
    '{{ 7 * 7 }} %s {0} <a name="x"/><para>',
]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("hostile") / "run")


def renamed(run: Path, to: Path, name: str) -> Path:
    """The run with a name for its mission, its streams and its video file."""
    shutil.copytree(run, to)
    for file in ("summary.json", "salient.geojson", "possible.geojson", "tracks.geojson"):
        document = json.loads((to / file).read_text())
        document["mission"] = name
        for feature in document.get("features", ()):
            said = feature["properties"]
            said["streams"], said["name"] = [name], name
            for picture in said.get("pictures", ()):
                picture["stream"], picture["file"] = name, name
        if file == "summary.json":
            document["verdict"]["sentence"] = f"{name} is the verdict."
        (to / file).write_text(json.dumps(document))
    return to


@pytest.mark.parametrize("name", NAMES, ids=["script", "cdata", "formula and unseen", "path", "templates"])
def test_a_name_is_data_never_markup(run: Path, tmp_path: Path, name: str) -> None:
    view = read_run(renamed(run, tmp_path / "run", name), AT)
    out = tmp_path / "out"
    names = write_exports(out, view, list(FORMATS))
    assert all((out / n).resolve().is_relative_to(out.resolve()) for n in names)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out", "run"]
    seen = name.replace("\x00", "").replace("\x1b", "").replace("\ud800", "").replace("\u202e", "")
    root = etree.parse(out / "places.kml").getroot()
    kml = {"k": "http://www.opengis.net/kml/2.2"}
    assert root.xpath("string(/k:kml/k:Document/k:name)", namespaces=kml) == seen
    # what Google Earth shows as HTML has it escaped
    for text in root.xpath("//k:description/text()", namespaces=kml):
        shown = etree.HTML(text)
        assert not shown.xpath("//script | //a | //b | //para | //*[@onload]")
    gpx = etree.parse(out / "places.gpx").getroot()
    assert gpx.find("{*}metadata/{*}name").text == seen
    event = etree.parse(out / "cot/place-1.cot").getroot()
    assert [child.tag for child in event.find("detail")] == [
        "contact",
        "color",
        "usericon",
        "archive",
        "remarks",
    ]
    assert event.find("detail/remarks").text.startswith(seen)
    with (out / "places.csv").open(newline="", encoding="utf-8") as file:
        row = next(csv.DictReader(file))
    assert row["mission"] == ("'" if seen.startswith("=") else "") + seen
    assert json.loads((out / "places.geojson").read_text())["mission"] == seen
    text = pypdf.PdfReader(out / "report.pdf").pages[0].extract_text()
    assert "is the verdict." in " ".join(text.split())


@pytest.mark.parametrize(
    "picture", ["../outside.png", "/etc/hostname", "crops/../../outside.png", "crops/link.png"]
)
def test_a_picture_outside_of_the_run_is_refused(run: Path, tmp_path: Path, picture: str) -> None:
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    (tmp_path / "outside.png").write_bytes(b"secret")
    (folder / "crops/link.png").symlink_to(tmp_path / "outside.png")
    document = json.loads((folder / "salient.geojson").read_text())
    document["features"][0]["properties"]["pictures"] = [{"picture": picture, "stream": "a", "time": "b"}]
    (folder / "salient.geojson").write_text(json.dumps(document))
    with pytest.raises(InputError, match="outside of the run directory"):
        read_run(folder, AT)


def _without_summary(folder: Path) -> None:
    (folder / "summary.json").unlink()


def _no_json(folder: Path) -> None:
    (folder / "salient.geojson").write_text("{")


def _a_list(folder: Path) -> None:
    (folder / "possible.geojson").write_text("[]")


def _no_probability(folder: Path) -> None:
    document = json.loads((folder / "salient.geojson").read_text())
    del document["features"][1]["properties"]["probability"]
    (folder / "salient.geojson").write_text(json.dumps(document))


def _other_version(folder: Path) -> None:
    document = json.loads((folder / "salient.geojson").read_text())
    (folder / "salient.geojson").write_text(json.dumps(document | {"version": 99}))


def _no_crop(folder: Path) -> None:
    (folder / "crops/place-1.png").unlink()


def _no_zone(folder: Path) -> None:
    document = json.loads((folder / "summary.json").read_text())
    (folder / "summary.json").write_text(json.dumps(document | {"time_zone": "../Mars"}))


@pytest.mark.parametrize(
    "spoil", [_no_zone, _without_summary, _no_json, _a_list, _no_probability, _other_version, _no_crop]
)
def test_what_is_no_run_is_refused_in_one_line(run: Path, tmp_path: Path, spoil: object) -> None:
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    assert callable(spoil)
    spoil(folder)
    with pytest.raises(InputError) as raised:
        read_run(folder, AT)
    assert "\n" not in str(raised.value)


def test_an_earlier_run_without_ways_is_exported_and_says_so(run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    for name in ("tracks.geojson", "search_area.geojson", "saliency.tif", "map.png", "second_look.geojson"):
        (folder / name).unlink()
    view = read_run(folder, AT)
    assert view.absent == tuple(
        f"the run directory has no {name}"
        for name in ("tracks.geojson", "search_area.geojson", "saliency.tif")
    )
    write_exports(tmp_path / "out", view, [name for name in FORMATS if name != "cog"])
    with pytest.raises(InputError, match=r"saliency\.tif"):
        write_exports(tmp_path / "out", view, ["cog"])


@pytest.mark.parametrize(("text", "found"), [("kml,shp", "'shp'"), ("", "nothing"), ("all,kml", "'all'")])
def test_a_format_that_there_is_not_is_refused(text: str, found: str) -> None:
    with pytest.raises(InputError, match=found):
        formats_of(text)


def test_nothing_found_is_an_empty_file_of_each_format(run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    for name in ("salient.geojson", "possible.geojson"):
        document = json.loads((folder / name).read_text())
        (folder / name).write_text(json.dumps(document | {"features": []}))
    view = read_run(folder, AT)
    write_exports(tmp_path / "out", view, list(FORMATS))
    assert (tmp_path / "out/places.csv").read_text().startswith("mission,rank,id,name")
    assert list((tmp_path / "out/cot").iterdir()) == []


def test_files_of_others_stay_and_places_that_are_gone_go(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    view = read_run(run, AT)
    write_exports(out, view, ["cot", "csv"])
    (out / "cot/mine.cot").write_text("mine")
    (out / "notes.txt").write_text("mine")
    fewer = dataclasses.replace(view, places=view.places[:2])
    write_exports(out, fewer, ["cot", "csv"])
    assert sorted(p.name for p in (out / "cot").iterdir()) == ["mine.cot", "place-2.cot", "place-3.cot"]
    assert (out / "notes.txt").read_text() == "mine"

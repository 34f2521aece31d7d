import sys
from datetime import UTC, datetime
from pathlib import Path

import pytest
from typer.testing import CliRunner

from actors.cli import app
from pipeline.errors import InputError
from pipeline.outputs.exports.view import read_run
from pipeline.storage.whole_or_nothing import FILE_LIST
from pipeline.view.decisions import append

sys.path.append(str(Path(__file__).parents[1] / "outputs"))
from run_folder import write_run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("export") / "run")


def export(*arguments: object) -> None:
    result = CliRunner().invoke(app, ["export", *map(str, arguments)])
    if result.exception is not None:
        raise result.exception


def test_files_are_written_beside_the_run_and_go_with_it(run: Path) -> None:
    export(run, "--to", "gpx, CSV,gpx")
    assert sorted(p.name for p in (run / "exports").iterdir()) == ["places.csv", "places.gpx"]
    # the next run in this directory removes them
    listed = (run / FILE_LIST).read_text().splitlines()
    assert {"exports/places.csv", "exports/places.gpx", "salient.geojson"} <= set(listed)


def test_what_leaves_the_team_lies_apart(run: Path, tmp_path: Path) -> None:
    export(run, "--to", "all", "--redact", "--out", tmp_path / "away")
    assert "Redacted" in (tmp_path / "away/places.geojson").read_text()
    assert not (tmp_path / "away/saliency.cog.tif").exists()
    export(run, "--to", "kml", "--redact")
    assert (run / "exports-redacted/places.kml").is_file()
    with pytest.raises(InputError, match="cog"):
        export(run, "--to", "cog", "--redact")


@pytest.mark.parametrize(("to", "found"), [("shapefile", "shapefile"), (",", "nothing")])
def test_an_unknown_format_is_one_line(run: Path, to: str, found: str) -> None:
    with pytest.raises(InputError, match=found):
        export(run, "--to", to)


def test_a_folder_that_is_no_run_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"summary\.json"):
        export(tmp_path, "--to", "kml")


def test_a_run_writes_the_formats_of_its_mission_and_is_not_lost_if_one_fails(tmp_path: Path) -> None:
    from pipeline.mission.run_directory import _export

    folder = write_run(tmp_path / "run")
    _export(folder, (), 10**18)
    assert not (folder / "exports").exists()
    _export(folder, ("gpx", "kml"), 10**18)
    assert sorted(p.name for p in (folder / "exports").iterdir()) == ["places.gpx", "places.kml"]
    (folder / "saliency.tif").write_bytes(b"no map")
    _export(folder, ("csv", "cog"), 10**18)
    assert "saliency.tif" in (folder / "exports/FAILED.txt").read_text()
    assert (folder / "exports/places.csv").is_file()


def test_the_command_hands_over_what_was_decided(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    one = read_run(run, datetime(2026, 12, 1, tzinfo=UTC)).places[0]
    said = {"who": "Ana", "kind": "reject", "place": one.id, "class_name": one.class_name,
            "latitude_deg": one.latitude_deg, "longitude_deg": one.longitude_deg}  # fmt: skip
    append(run, "2026-12-01T05:00:00Z", said)
    for more in ([], ["--watch"]):
        export(run, "--to", "csv", "--out", tmp_path / "away", *more)
        assert "rejected by Ana" in (tmp_path / "away/places.csv").read_text(encoding="utf-8")
        (tmp_path / "away/places.csv").unlink()

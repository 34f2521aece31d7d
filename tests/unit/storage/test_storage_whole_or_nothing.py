import errno
import json
import stat
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.storage.whole_or_nothing import (
    FILE_LIST,
    SUMMARY_FILE,
    WRITTEN_BY,
    check_run_directory,
    replacing,
    run_directory,
    write_text,
)


class PowerCutError(Exception):
    pass


OURS = json.dumps({"written_by": WRITTEN_BY})


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    write_text(path, "new é")
    assert path.read_text(encoding="utf-8") == "new é"
    assert list(tmp_path.iterdir()) == [path]


def test_a_failure_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with suppress(PowerCutError), replacing(path) as temporary:
        temporary.write_text("half")
        raise PowerCutError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_new_run_directory_appears_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "runs" / "demo"
    with run_directory(path) as folder:
        (folder / SUMMARY_FILE).write_text(OURS)
        assert not path.exists()
        assert folder.parent == path.parent
    assert [p.name for p in path.parent.iterdir()] == ["demo"]
    assert json.loads((path / SUMMARY_FILE).read_text())["written_by"] == WRITTEN_BY
    assert stat.S_IMODE(path.stat().st_mode) & 0o500 == 0o500


def test_an_empty_folder_is_taken(tmp_path: Path) -> None:
    with run_directory(tmp_path) as folder:
        (folder / "map.png").write_bytes(b"1")
    assert (tmp_path / "map.png").read_bytes() == b"1"


def test_a_later_run_replaces_its_files_and_keeps_the_users(tmp_path: Path) -> None:
    path = tmp_path / "demo"
    with run_directory(path) as folder:
        (folder / SUMMARY_FILE).write_text(OURS)
        (folder / "map.png").write_bytes(b"1")
    (path / "notes.txt").write_text("mine")
    with run_directory(path) as folder:
        (folder / SUMMARY_FILE).write_text(OURS)
        (folder / "map.png").write_bytes(b"2")
        (folder / "more").mkdir()
        (folder / "more" / "crop.png").write_bytes(b"3")
    assert (path / "map.png").read_bytes() == b"2"
    assert (path / "more" / "crop.png").read_bytes() == b"3"
    assert (path / "notes.txt").read_text() == "mine"
    assert [p.name for p in tmp_path.iterdir()] == ["demo"]


def run_with(path: Path, *names: str) -> None:
    with run_directory(path) as folder:
        (folder / SUMMARY_FILE).write_text(OURS)
        for name in names:
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(name)


def names(path: Path) -> set[str]:
    return {p.relative_to(path).as_posix() for p in path.rglob("*") if p.is_file()}


def test_what_an_earlier_run_left_does_not_survive_beside_a_later_one(tmp_path: Path) -> None:
    path = tmp_path / "demo"
    run_with(
        path, "report.html", "second_flight.plan", "second_flight.kmz", "saliency-car.tif", "crops/1.png"
    )
    (path / "notes.txt").write_text("mine")
    (path / "second_flight_edited.plan").write_text("mine")
    run_with(path, "report.html", "crops/2.png")
    mine = {"notes.txt", "second_flight_edited.plan"}
    assert names(path) == {SUMMARY_FILE, FILE_LIST, "report.html", "crops/2.png"} | mine


def test_of_a_run_that_kept_no_list_the_known_files_are_removed(tmp_path: Path) -> None:
    path = tmp_path / "demo"
    run_with(path, "report.html", "second_flight.plan", "salient.geojson", "area.kml")
    (path / FILE_LIST).unlink()
    run_with(path, "report.html")
    assert names(path) == {SUMMARY_FILE, FILE_LIST, "report.html", "area.kml"}


def test_a_list_cannot_make_a_run_remove_files_elsewhere(tmp_path: Path) -> None:
    path, other = tmp_path / "demo", tmp_path / "other.txt"
    run_with(path, "report.html")
    other.write_text("mine")
    (path / FILE_LIST).write_text(f"../other.txt\n{other}\n\nreport.html\n")
    run_with(path)
    assert other.exists()
    assert names(path) == {SUMMARY_FILE, FILE_LIST}


def test_a_failed_run_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "demo"
    with run_directory(path) as folder:
        (folder / SUMMARY_FILE).write_text(OURS)
    before = {p.name: p.read_bytes() for p in path.iterdir()}
    with suppress(PowerCutError), run_directory(path) as folder:
        (folder / SUMMARY_FILE).write_text("half")
        raise PowerCutError
    assert {p.name: p.read_bytes() for p in path.iterdir()} == before
    assert [p.name for p in tmp_path.iterdir()] == ["demo"]


@pytest.mark.parametrize("content", [None, "", "[]", '{"written_by": "another program"}', "\xff"])
def test_a_folder_of_others_is_refused(tmp_path: Path, content: str | None) -> None:
    (tmp_path / "holiday.jpg").write_bytes(b"1")
    if content is not None:
        (tmp_path / SUMMARY_FILE).write_text(content, encoding="latin-1")
    with pytest.raises(InputError, match="a folder with other files"):
        check_run_directory(tmp_path)
    with pytest.raises(InputError, match="a folder with other files"), run_directory(tmp_path):
        pass


def test_a_file_is_no_run_directory(tmp_path: Path) -> None:
    path = tmp_path / "demo"
    path.write_text("x")
    with pytest.raises(InputError, match="a file"):
        check_run_directory(path)


def test_a_run_directory_below_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError), run_directory(tmp_path / "file" / "demo"):
        pass


def test_files_that_appear_during_the_run_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "demo"
    with ExitStack() as stack:
        folder = stack.enter_context(run_directory(path))
        (folder / SUMMARY_FILE).write_text(OURS)
        path.mkdir()
        (path / "notes.txt").write_text("mine")
        with pytest.raises(InputError, match="other files"):
            stack.close()
    assert [p.name for p in path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_on_a_full_disk_what_is_finished_is_kept_and_named(tmp_path: Path, code: int) -> None:
    out = tmp_path / "run"

    def fill() -> None:
        with run_directory(out) as folder:
            (folder / "map.png").write_bytes(b"whole")
            (folder / ".report.html.1.part").write_bytes(b"half")
            raise OSError(code, "no space")

    with pytest.raises(
        InputError, match=r"a full disk; what was finished is in .*run\.incomplete \(map\.png\)"
    ):
        fill()
    assert [p.name for p in (tmp_path / "run.incomplete").iterdir()] == ["map.png"]
    assert not out.exists()

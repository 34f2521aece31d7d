"""The log of a run: quiet by default, one JSON object a line, in the run directory, or beside it after a failure."""

import faulthandler
import json
import logging
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.logs import FOLDER_VARIABLE, LOG_FILE, Log, keep_log, log_of_actor, logged_run
from pipeline.mission.found_place_crops import Crop
from pipeline.outputs.exports.view import PictureOf
from pipeline.outputs.place_picture import PlacePicture


def lines(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def test_nobody_hears_a_log_without_a_run(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    Log("fusion").event("map finished", sightings=3)
    Log("fusion").warning("late", count=1)
    keep_log(tmp_path / LOG_FILE)
    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())
    assert not logging.getLogger("searchlight").propagate


def test_a_line_says_when_in_which_room_what_changed_and_by_what(tmp_path: Path) -> None:
    with logged_run(tmp_path / "run"):
        Log("ingest").event("stream read", stream="drone-1", path=Path("a.mp4"), text="zwei\nZeilen ü")
        Log("outputs").warning("disk", free=0.5)
        keep_log(tmp_path / "kept")
    first, second = lines(tmp_path / "kept")
    assert str(first.pop("time")).endswith("+00:00")
    assert first == {
        "room": "ingest",
        "level": "info",
        "event": "stream read",
        "stream": "drone-1",
        "path": "a.mp4",
        "text": "zwei\nZeilen ü",
    }
    assert (second["room"], second["level"], second["free"]) == ("outputs", "warning", 0.5)
    assert [p.name for p in tmp_path.iterdir()] == ["kept"]


@pytest.mark.parametrize("error", [ValueError("bad"), KeyboardInterrupt(), SystemExit(2)])
def test_after_a_failure_the_log_is_kept_beside_the_run_directory(
    tmp_path: Path, error: BaseException
) -> None:
    def run() -> None:
        with logged_run(tmp_path / "run"):
            Log("allocation").event("planned")
            raise error

    with pytest.raises(type(error)):
        run()
    assert [p.name for p in tmp_path.iterdir()] == ["run.failed-run.log"]
    kept = lines(tmp_path / "run.failed-run.log")
    assert [line["event"] for line in kept] == ["planned", "run failed"]
    assert type(error).__name__ in str(kept[1]["error"])
    with logged_run(tmp_path / "run"):
        Log("allocation").event("planned")
    assert not list(tmp_path.iterdir())


def test_two_runs_one_after_the_other_do_not_share_a_log(tmp_path: Path) -> None:
    for name in "ab":
        with logged_run(tmp_path / name):
            Log("mission").event(f"run {name}")
            keep_log(tmp_path / f"{name}.txt")
    assert [[line["event"] for line in lines(tmp_path / f"{n}.txt")] for n in "ab"] == [["run a"], ["run b"]]


def test_input_that_is_refused_leaves_no_log(tmp_path):
    with pytest.raises(InputError), logged_run(tmp_path / "run"):
        raise InputError("mission.yaml", "nothing", "a mission")
    assert not list(tmp_path.iterdir())


def test_an_actor_logs_where_the_environment_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = logging.getLogger("searchlight")
    before = list(root.handlers)
    try:
        for folder in (None, tmp_path / "absent"):
            monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
            if folder is not None:
                monkeypatch.setenv(FOLDER_VARIABLE, str(folder))
            log_of_actor("source-a")
            assert root.handlers == before
        monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
        log_of_actor("source-a/../../b c")
        Log("actors").warning("failed", error="no more")
    finally:
        faulthandler.enable(sys.__stderr__ or sys.stderr)  # not into a file that is closed now
        for handler in root.handlers[len(before) :]:
            root.removeHandler(handler)
            handler.close()
    (path,) = tmp_path.iterdir()
    assert path.name == "source-a-..-..-b-c.log"
    assert [json.loads(line)["event"] for line in path.read_text().splitlines()] == ["actor begins", "failed"]


@pytest.mark.parametrize(
    "wrap", [lambda value: value, lambda value: [{"a": value}], lambda value: {"b": [value]}]
)
def test_a_picture_of_a_person_is_never_in_a_log(tmp_path: Path, wrap: Callable[[object], object]) -> None:
    pixels = np.arange(12, dtype=np.uint8).reshape(2, 2, 3) + 200
    png = b"\x89PNG secret"
    pictures = (
        *(png, bytearray(png), memoryview(png), pixels),
        *(PlacePicture(1, png, "a", 0), PictureOf(png, "a", "b"), Crop(1, None, png)),  # type: ignore[arg-type]
    )
    with logged_run(tmp_path / "run"):
        for picture in pictures:
            Log("outputs").event("crop", picture=wrap(picture))
        keep_log(tmp_path / "kept")
    text = (tmp_path / "kept").read_text(encoding="utf-8")
    assert len(text.splitlines()) == len(pictures)
    said = [json.dumps(line["picture"]) for line in lines(tmp_path / "kept")]
    for secret in ("PNG", "secret", "200", "211"):
        assert not [one for one in said if secret in one]
    assert "<11 bytes>" in text
    assert "<ndarray (2, 2, 3)>" in text

"""What an operator asks of a mission that flies is done once and answered, or refused with the reason."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from actors.cli import app
from pipeline.errors import InputError
from pipeline.mission.controller.events import Event, MissionStopped, StreamPaused, StreamStopped
from pipeline.mission.operator import FOLDER, OperatorsDesk, ask


class Mission:
    """A run that looks at its desk every few milliseconds."""

    def __init__(self, run: Path) -> None:
        self.areas: list[tuple[str, bytes]] = []
        self.desk = OperatorsDesk(run, ["drone-1", "drone-2"], self._area)
        self.events, self.over = list[Event](), False
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _area(self, file: Path) -> str:
        if b"Polygon" not in file.read_bytes():
            raise InputError(file, "no polygon", "a Polygon")
        self.areas.append((file.suffix, file.read_bytes()))
        return "the search area is now 1 m2"

    def _look(self) -> None:
        while not self.over:
            self.events += self.desk.events()
            time.sleep(0.01)

    def end(self) -> list[Event]:
        self.over = True
        self._thread.join()
        self.desk.close()
        return self.events


@pytest.mark.parametrize(
    ("what", "stream", "event"),
    [
        ("pause", "drone-1", StreamPaused("drone-1", True)),
        ("resume", "drone-2", StreamPaused("drone-2", False)),
        ("stop", "drone-1", StreamStopped("drone-1")),
        ("stop", None, MissionStopped()),
        ("revoke", "drone-2", StreamStopped("drone-2")),
    ],
)
def test_what_is_asked_is_heard_once_and_answered(
    tmp_path: Path, what: str, stream: str | None, event: Event
) -> None:
    mission = Mission(tmp_path)
    given = ["mission", what, str(tmp_path), *([] if stream is None else [stream])]
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 0, result.output
    assert (stream or "mission") in result.output
    assert mission.end() == [event]
    assert not (tmp_path / FOLDER).exists()


def test_a_stream_that_there_is_not_is_refused_with_those_there_are(tmp_path: Path) -> None:
    mission = Mission(tmp_path)
    with pytest.raises(InputError, match=r"drone-9.*one of drone-1, drone-2"):
        ask(tmp_path, "pause", "drone-9")
    assert mission.end() == []


def test_a_folder_where_nothing_flies_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no mission that flies"):
        ask(tmp_path, "stop", None)


def test_a_mission_that_does_not_answer_is_said_and_the_request_is_taken_back(tmp_path: Path) -> None:
    (tmp_path / FOLDER).mkdir()
    with pytest.raises(InputError, match=r"no answer within 0\.2 s"):
        ask(tmp_path, "stop", None, within_s=0.2)
    assert not list((tmp_path / FOLDER).iterdir())


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"what": "pause"}', '{"what": "rm", "stream": null}', '{"what": "pause", "stream": 3}',
             '{"what": "pause", "stream": null}', "x" * 20_000,
             '{"what": "area", "stream": null}', '{"what": "area", "stream": null, "file": "../1.json"}'],
)  # fmt: skip
def test_a_request_that_cannot_be_read_is_answered_and_does_nothing(tmp_path: Path, text: str) -> None:
    desk = OperatorsDesk(tmp_path, ["drone-1"], str)
    (tmp_path / FOLDER / "1.json").write_text(text)
    assert desk.events() == []
    assert '"taken": false' in (tmp_path / FOLDER / "1.answer").read_text()
    assert not (tmp_path / FOLDER / "1.json").exists()


def test_what_was_asked_of_a_run_before_is_not_asked_of_this_one(tmp_path: Path) -> None:
    (tmp_path / FOLDER).mkdir()
    (tmp_path / FOLDER / "1.json").write_text('{"what": "stop", "stream": null}')
    assert OperatorsDesk(tmp_path, ["drone-1"], str).events() == []


def test_another_search_area_is_handed_over_as_a_copy_of_its_file(tmp_path: Path) -> None:
    mission = Mission(tmp_path)
    drawn = tmp_path / "drawn.kml"
    drawn.write_text("<Polygon>")
    result = CliRunner().invoke(app, ["mission", "area", str(tmp_path), str(drawn)])
    assert result.exit_code == 0, result.output
    assert "the search area is now 1 m2" in result.output
    assert mission.end() == []
    assert mission.areas == [(".kml", b"<Polygon>")]


def test_a_search_area_that_cannot_be_used_is_refused_with_its_own_name(tmp_path: Path) -> None:
    mission = Mission(tmp_path)
    drawn = tmp_path / "drawn.kml"
    with pytest.raises(InputError, match=r"drawn\.kml: found a file that cannot be read"):
        ask(tmp_path, "area", None, file=drawn)
    drawn.write_text("<Point>")
    with pytest.raises(InputError, match=r"drawn\.kml: found no polygon; expected a Polygon"):
        ask(tmp_path, "area", None, file=drawn)
    mission.end()
    assert mission.areas == []

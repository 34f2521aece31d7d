"""What ``check`` pushes through every planned step, it says where it was lost; and a good mission loses nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.detection import Detector
from pipeline.link.codec import Decoder
from pipeline.mission.local import FinishedRun, run_local
from pipeline.mission.one_picture import push_one_picture
from pipeline.mission.planning import plan
from pipeline.mission.prepared import PreparedMission, prepare
from pipeline.mission.run_directory import write_run_directory


@pytest.fixture(scope="module")
def prepared(small_mission: Path) -> PreparedMission:
    return prepare(small_mission)


def test_a_picture_of_each_stream_goes_to_each_planned_detector(
    prepared: PreparedMission, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_at = []
    detect = Detector.detect
    monkeypatch.setattr(
        Detector, "detect", lambda self, image: looked_at.append(image.shape) or detect(self, image)
    )
    planned = plan(prepared)
    assert push_one_picture(prepared, planned) == []
    assert len(looked_at) == len(planned.assignments) > 0


def test_where_it_is_lost_is_said(prepared: PreparedMission, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(self: Decoder, data: bytes) -> None:
        raise ValueError("damaged")

    monkeypatch.setattr(Decoder, "decode", broken)
    planned = plan(prepared)
    findings = push_one_picture(prepared, planned)
    assert len(findings) == len(planned.assignments)
    assert {(f.severity, f.cause) for f in findings} == {("warning", "picture_lost")}
    assert all("undecodable" in f.found for f in findings)


def test_a_video_without_a_picture_that_can_be_decoded_is_named(
    prepared: PreparedMission, monkeypatch: pytest.MonkeyPatch
) -> None:
    for stream in prepared.streams:
        monkeypatch.setattr(type(stream.source), "planes_at", lambda self, times_s: iter(()))
    findings = push_one_picture(prepared, plan(prepared))
    assert [f.cause for f in findings] == ["no_picture"] * len(prepared.streams)
    assert str(prepared.streams[0].path) in findings[0].where


def test_a_run_whose_boxes_are_too_large_says_so_in_its_verdict(
    prepared: PreparedMission, tmp_path: Path
) -> None:
    finished: FinishedRun = run_local(prepared, plan(prepared), lambda *_: None)
    sizes = finished.reducer.fuser.sizes
    stream = prepared.streams[0].stream
    sizes.update({(stream, round(50 * float(np.log(2.8)))): 1000})
    summary = write_run_directory(prepared, finished, tmp_path / "run")
    assert summary.verdict.kind == "cannot_be_trusted"
    assert any(f.cause == "height_off/focal_length" for f in summary.findings)
    assert "height_off/focal_length" in (tmp_path / "run" / "summary.json").read_text(encoding="utf-8")

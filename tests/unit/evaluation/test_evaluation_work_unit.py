"""The unit of work: what is encoded, decoded and found; what is kept of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.detection import Detector
from pipeline.errors import InputError
from pipeline.evaluation.measuring import work_unit as unit_module
from pipeline.evaluation.measuring.cache import Cache
from pipeline.evaluation.measuring.packet_file import read_packets, writing_packets
from pipeline.evaluation.measuring.work_unit import Condition, Model, Unit, first_pictures, work

NANO = Path(__file__).parents[3] / "configs/detectors/nano.onnx"


@pytest.fixture
def unit(small_mission) -> Unit:
    return Unit(
        sequence="drone-1",
        files=(small_mission.parent / "drone-1.mp4",),
        is_video=True,
        frame_rate_hz=30.0,
        kept=tuple(range(60)),
        looked={0: 0, 30: 10, 45: 15},
        size=(512, 288),
        condition=Condition("h264", 250e3),
        keyframe_interval=60,
        models=(Model("nano", NANO, "0" * 64),),
        score_cutoff=0.05,
    )


def same(a, b):
    assert a.image.tolist() == b.image.tolist()
    np.testing.assert_array_equal(a.boxes_px, b.boxes_px)
    np.testing.assert_array_equal(a.score, b.score)


def test_kept_packets_give_the_same_detections_without_encoding_again(unit, tmp_path):
    unit = replace(unit, packets=tmp_path / "streams/x.packets")
    first, again = work(unit), work(unit)
    assert "encode" in first.seconds
    assert "encode" not in again.seconds
    assert (first.total_bytes, first.largest_packet_bytes) == (again.total_bytes, again.largest_packet_bytes)
    same(first.found["nano"], again.found["nano"])
    assert set(first.found["nano"].image.tolist()) <= {0, 10, 15}
    assert len(list(read_packets(unit.packets))) == first.frames == 60


def test_a_better_bitrate_costs_more_bytes_and_changes_the_picture_less(unit):
    original = first_pictures(replace(unit, condition=Condition()), 3)
    sizes, errors = [], []
    for bitrate in (50e3, 2.5e6):
        at = replace(unit, condition=Condition("h264", bitrate))
        sizes.append(work(at).total_bytes)
        errors.append(
            np.mean(
                [
                    np.abs(a.astype(int) - b).mean()
                    for a, b in zip(first_pictures(at, 3), original, strict=True)
                ]
            )
        )
    assert sizes[0] < sizes[1]
    assert errors[0] > errors[1]


def test_without_a_codec_the_pictures_are_looked_at_in_the_wanted_size(unit):
    (image, *rest) = first_pictures(replace(unit, condition=Condition(), size=(256, 144)), 9)
    assert image.shape == (144, 256, 3)
    assert len(rest) == 2


def test_numbers_that_are_not_finite_are_counted_and_left_out(unit, monkeypatch):
    class Broken(Detector):
        def __init__(self):
            super().__init__(None, None, None, {0: (0,)}, score_threshold=0.3)

        def candidates(self, image):
            boxes = np.array([[1.0, 1, 5, 5], [np.nan, 1, 5, 5], [1, 1, 5, 5], [np.inf, 1, 5, 5]])
            return (
                boxes,
                np.array([0.9, 0.9, np.nan, 0.1]),
                np.zeros(4, int),
            )  # the last is below the threshold

        def chosen(self, image, boxes, scores, classes):
            likely = scores >= self.score_threshold
            return boxes[likely], scores[likely], None

    monkeypatch.setattr(unit_module, "_opened", lambda *_: Broken())
    found = work(unit).found["nano"]
    assert found.not_finite == 2 * 3
    assert found.boxes_px.tolist() == [[1, 1, 5, 5]] * 3


def test_the_cache_gives_back_what_was_stored_and_only_for_the_same_content(unit, tmp_path):
    cache, (model,) = Cache(tmp_path), unit.models
    result = work(unit)
    cache.store(unit, "source", result)
    known = cache.load(unit, "source", model)
    same(known.found["nano"], result.found["nano"])
    assert (known.total_bytes, known.frames, known.seconds) == (result.total_bytes, 60, result.seconds)
    for other in (
        replace(unit, condition=Condition("h264", 251e3)),
        replace(unit, condition=Condition("h265", 250e3)),
        replace(unit, score_cutoff=0.1),
        replace(unit, keyframe_interval=30),
        replace(unit, looked={0: 0}),
    ):
        assert cache.load(other, "source", model) is None
    assert cache.load(unit, "another source", model) is None
    assert cache.load(unit, "source", replace(model, sha256="1" * 64)) is None
    assert cache.packets(unit, "a") != cache.packets(unit, "b")


def test_a_damaged_cache_file_counts_as_absent(unit, tmp_path):
    cache, (model,) = Cache(tmp_path), unit.models
    cache.store(unit, "source", work(unit))
    (file,) = (tmp_path / "found").iterdir()
    file.write_bytes(file.read_bytes()[:200])
    assert cache.load(unit, "source", model) is None


def test_packets_come_back_as_they_were_and_a_broken_write_leaves_nothing(tmp_path):
    path = tmp_path / "a.packets"
    with writing_packets(path) as write:
        for data in (b"one", b"", b"three"):
            write(data)
    assert list(read_packets(path)) == [b"one", b"", b"three"]
    with pytest.raises(ZeroDivisionError), writing_packets(tmp_path / "b.packets") as write:
        write(b"half" * (1 // 0))
    assert [p.name for p in tmp_path.iterdir()] == ["a.packets"]
    path.write_bytes(path.read_bytes()[:-2])
    with pytest.raises(InputError, match="cut off"):
        list(read_packets(path))

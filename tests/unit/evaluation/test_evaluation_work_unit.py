"""The unit of work: what is encoded, decoded and found; what is kept of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.detection import Detector
from pipeline.errors import InputError
from pipeline.evaluation.measuring import cache as cache_module
from pipeline.evaluation.measuring import transcoding
from pipeline.evaluation.measuring import work_unit as unit_module
from pipeline.evaluation.measuring.cache import Cache
from pipeline.evaluation.measuring.packet_file import read_packets, writing_packets
from pipeline.evaluation.measuring.unit import Condition, Model, Unit
from pipeline.evaluation.measuring.work_unit import UnitResult, first_pictures
from pipeline.evaluation.measuring.work_unit import work as work_together

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


def work(unit: Unit) -> UnitResult:
    (result,) = work_together((unit,))
    return result


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


def test_units_of_one_source_decode_it_once_and_find_what_each_finds_alone(unit, tmp_path, monkeypatch):
    decoded = []

    def counted(path):
        for frame in transcoding_frames(path):
            decoded.append(frame.pts)
            yield frame

    transcoding_frames = transcoding.decoded_frames
    conditions = (Condition(), Condition("h264", 100e3), Condition("h264", 1e6), Condition("vp9", 250e3))
    units = tuple(replace(unit, condition=c) for c in conditions)
    units = (*units[:3], replace(units[3], packets=tmp_path / "kept.packets"))
    alone = [work(replace(u, packets=None)) for u in units]
    monkeypatch.setattr(transcoding, "decoded_frames", counted)
    together = work_together(units)
    assert len(decoded) == 60
    for one, other in zip(alone, together, strict=True):
        assert (one.total_bytes, one.largest_packet_bytes) == (other.total_bytes, other.largest_packet_bytes)
        same(one.found["nano"], other.found["nano"])
    # the decoding of the source is shared out, and nothing is counted twice
    assert len({round(r.seconds["source"], 9) for r in together}) == 1
    again = work_together(units)  # the kept stream needs no source, the others do
    assert "encode" not in again[3].seconds
    same(again[3].found["nano"], alone[3].found["nano"])
    assert len(decoded) == 120


def test_a_kept_stream_that_lacks_packets_is_refused(unit, tmp_path):
    unit = replace(unit, packets=tmp_path / "x.packets")
    work(unit)
    packets = list(read_packets(unit.packets))
    with writing_packets(unit.packets) as write:
        for data in packets[:-1]:
            write(data)
    with pytest.raises(InputError, match=r"x\.packets: found a stream that is cut off"):
        work(unit)


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


def test_what_other_code_made_is_made_again(unit, tmp_path, monkeypatch):
    cache, (model,) = Cache(tmp_path), unit.models
    streams = cache.packets(unit, "source")
    cache.store(unit, "source", work(unit))
    assert cache.load(unit, "source", model) is not None
    here = cache_module.code_sha256

    def edited(*changed):
        return lambda *modules: here(*modules) + str(bool(set(changed) & set(modules)))

    monkeypatch.setattr(cache_module, "code_sha256", edited())
    unchanged = cache.packets(unit, "source")
    monkeypatch.setattr(cache_module, "code_sha256", edited("pipeline.detection"))
    assert cache.load(unit, "source", model) is None
    assert cache.packets(unit, "source") == unchanged != streams  # how boxes are found changes no stream
    monkeypatch.setattr(cache_module, "code_sha256", edited("pipeline.link.codec"))
    assert cache.packets(unit, "source") != unchanged


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

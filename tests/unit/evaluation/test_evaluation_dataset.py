"""Data sets: what is read, and what is wrong with one is counted, named, and refused or left out."""

from __future__ import annotations

import json
from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.config.evaluation import FaultPolicy
from pipeline.errors import InputError
from pipeline.evaluation.datasets.coco import CocoOptions, read_coco
from pipeline.evaluation.datasets.dataset import joined, kept_frames, require_aspect, sampled_pictures, scaled
from pipeline.evaluation.datasets.fault_log import FaultLog

SIZE = (64, 48)
SKIP = FaultPolicy(**dict.fromkeys(FaultPolicy.model_fields, "skip"))


def write_video(path: Path, frames: int, rate: int = 30) -> None:
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=rate, options={"preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for k in range(frames):
            image = np.full((SIZE[1], SIZE[0], 3), 5 * k % 255, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))


def document(frames=range(0, 30, 3), video="a.mp4") -> dict:
    return {
        "images": [
            {"id": f, "file_name": f"{video}#{f}", "width": SIZE[0], "height": SIZE[1]} for f in frames
        ],
        "annotations": [
            {
                "id": k + 1,
                "image_id": f,
                "category_id": 1,
                "bbox": [10, 10, 20, 30],
                "area": 600,
                "iscrowd": 0,
            }
            for k, f in enumerate(frames)
        ],
        "categories": [{"id": 1, "name": "person"}, {"id": 2, "name": "boat"}],
    }


@pytest.fixture
def folder(tmp_path):
    write_video(tmp_path / "a.mp4", 30)
    return tmp_path


def read(folder, content, policy=None, categories=("person",), frame_rate=None):
    path = folder / "truth.json"
    path.write_text(json.dumps(content))
    log = FaultLog(policy or FaultPolicy())
    options = CocoOptions(folder, categories, 0.3, frame_rate, False)
    return read_coco(path, options, log), log


def test_a_video_with_its_boxes(folder):
    dataset, log = read(folder, document())
    (sequence,) = dataset.sequences
    assert (sequence.frames, sequence.frame_rate, sequence.count) == (30, 30.0, 10)
    assert [p.frame for p in dataset.pictures] == list(range(0, 30, 3))
    assert dataset.truth.bbox.tolist() == [[10, 10, 20, 30]] * 10
    assert log.lines() == []


def test_crowds_ignored_and_hidden_people_are_ignore_regions(folder):
    content = document()
    content["annotations"][0]["iscrowd"] = 1
    content["annotations"][1]["ignore"] = 1
    content["annotations"][2]["visible_share"] = 0.2
    dataset, _ = read(folder, content)
    assert dataset.truth.crowd.tolist() == [True] * 3 + [False] * 7


def test_other_categories_are_left_out(folder):
    content = document()
    content["annotations"][0]["category_id"] = 2
    assert len(read(folder, content)[0].truth) == 9
    assert len(read(folder, content, categories=("person", "boat"))[0].truth) == 10
    with pytest.raises(InputError, match="found person, boat; expected one of swimmer"):
        read(folder, content, categories=("swimmer",))


def test_the_context_gives_the_expected_size_of_a_person(folder):
    content = document()
    content["images"][0]["context"] = {"height_m": 15, "pitch_deg": -90, "focal_px": 900}
    dataset, _ = read(folder, content)
    assert dataset.pictures[0].expected_px == pytest.approx(30.0)
    assert dataset.pictures[1].expected_px is None


def unknown_image(content):
    content["annotations"][0]["image_id"] = 999


def missing_video(content):
    for image in content["images"]:
        image["file_name"] = image["file_name"].replace("a.mp4", "b.mp4")


def outside(content):
    content["annotations"][3]["bbox"] = [50, 10, 20, 30]


def beyond(content):
    content["annotations"][3]["bbox"] = [500, 10, 20, 30]


def no_area(content):
    content["annotations"][3]["bbox"] = [5, 5, 0, 10]


def same_image(content):
    content["images"].append(dict(content["images"][0]))


def same_annotation(content):
    content["annotations"].append(dict(content["annotations"][0], bbox=[1, 1, 5, 5]))


def unlisted(content):
    content["annotations"][4]["category_id"] = 7


def too_short(content):
    content["images"] = content["images"][:5]
    content["annotations"] = content["annotations"][:5]


def too_long(content):
    content["images"].append({"id": 30, "file_name": "a.mp4#30", "width": SIZE[0], "height": SIZE[1]})


FAULTS = {
    "an annotation of no listed picture": (unknown_image, "missing_image", 1, 9, "annotations.id=1.image_id"),
    "a video that is not there": (missing_video, "missing_image", 10, 0, "images.id=0.file_name"),
    "a box partly outside": (outside, "outside_box", 1, 10, "annotations.id=4.bbox"),
    "a box wholly outside": (beyond, "outside_box", 1, 9, "annotations.id=4.bbox"),
    "a box without area": (no_area, "outside_box", 1, 9, "annotations.id=4.bbox"),
    "a picture's id twice": (same_image, "duplicate_id", 1, 10, "images.10.id"),
    "an annotation's id twice": (same_annotation, "duplicate_id", 1, 10, "annotations.10.id"),
    "a category that is not listed": (unlisted, "unknown_category", 1, 9, "annotations.id=5.category_id"),
    "a video that goes on after the annotations": (too_short, "frame_count", 1, 5, "images of a"),
    "annotations that go on after the video": (too_long, "frame_count", 1, 10, "images of a"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_refused_with_its_place(folder, name):
    spoil, kind, _, _, where = FAULTS[name]
    content = document()
    spoil(content)
    others = FaultPolicy(**{k: "skip" for k in FaultPolicy.model_fields if k != kind})
    with pytest.raises(InputError) as raised:
        read(folder, content, others)
    assert f"truth.json {where}" in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_counted_and_left_out_where_that_is_configured(folder, name):
    spoil, kind, count, boxes, _ = FAULTS[name]
    content = document()
    spoil(content)
    dataset, log = read(folder, content, SKIP)
    assert log.counts == {kind: count}
    assert log.lines()[0].startswith(f"{kind}: {count} (")
    assert len(dataset.truth) == boxes


def test_a_box_that_is_cut_to_the_picture_has_the_area_of_what_is_left(folder):
    content = document()
    outside(content)
    dataset, _ = read(folder, content, SKIP)
    assert dataset.truth.bbox[3].tolist() == [50, 10, 14, 30]
    assert dataset.truth.area[3] == 14 * 30


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("[", "not JSON"),
        ("{}", "found nothing"),
        ('{"images": 3, "annotations": [], "categories": []}', "found 3"),
    ],
)
def test_what_is_no_coco_file_is_one_line(folder, text, found):
    (folder / "truth.json").write_text(text)
    with pytest.raises(InputError, match=found):
        read_coco(
            folder / "truth.json", CocoOptions(folder, ("person",), 0.3, None, False), FaultLog(FaultPolicy())
        )


def test_each_tick_has_the_first_annotated_picture_at_or_after_it(folder):
    dataset, _ = read(folder, document())
    (sequence,) = dataset.sequences
    frames = [dataset.pictures[n].frame for n in sampled_pictures(dataset, sequence, 4.0)]
    assert frames == [0, 9, 15, 24]  # ticks at 0, 7.5, 15, 22.5
    assert kept_frames(sequence, 30.0).tolist() == list(range(30))
    kept = kept_frames(sequence, 10.0)
    assert kept.tolist() == list(range(0, 30, 3))
    assert kept_frames(sequence, 60.0).tolist() == list(range(30))
    among = [
        dataset.pictures[n].frame
        for n in sampled_pictures(dataset, sequence, 2.0, kept_frames(sequence, 5.0))
    ]
    assert among == [0, 18]


def images(folder, names):
    for k, name in enumerate(names):
        (folder / name).parent.mkdir(exist_ok=True)
        with av.open(str(folder / name), "w", format="image2") as container:
            stream = container.add_stream("png")
            stream.width, stream.height, stream.pix_fmt = *SIZE, "rgb24"
            frame = av.VideoFrame.from_ndarray(np.full((SIZE[1], SIZE[0], 3), k, np.uint8), format="rgb24")
            container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
    return {
        "images": [
            {"id": k + 5, "file_name": n, "width": SIZE[0], "height": SIZE[1]} for k, n in enumerate(names)
        ],
        "annotations": [{"id": 1, "image_id": 5, "category_id": 1, "bbox": [10, 10, 20, 30]}],
        "categories": [{"id": 1, "name": "person"}],
    }


def test_images_stand_alone_without_a_frame_rate_and_are_a_sequence_with_one(tmp_path):
    content = images(tmp_path, ["one/0.png", "one/1.png", "two/0.png"])
    alone, _ = read(tmp_path, content)
    assert [q.count for q in alone.sequences] == [1, 1, 1]
    assert [len(sampled_pictures(alone, q, 2.0)) for q in alone.sequences] == [1, 1, 1]
    with pytest.raises(InputError, match="without a frame rate"):
        kept_frames(alone.sequences[0], 30.0)
    together, _ = read(tmp_path, content, frame_rate=10.0)
    assert [(q.name, q.count) for q in together.sequences] == [("one", 2), ("two", 1)]
    assert [p.frame for p in together.pictures] == [0, 1, 0]


def test_ids_of_pictures_and_boxes_may_be_texts(tmp_path):
    content = images(tmp_path, ["one/0.png", "one/1.png", "two/0.png"])
    for image in content["images"]:
        image["id"] = f"b-{image['id']}"
    content["annotations"][0] |= {"id": "x", "image_id": "b-7"}
    dataset, _ = read(tmp_path, content, frame_rate=10.0)
    assert [(q.name, q.count) for q in dataset.sequences] == [("one", 2), ("two", 1)]
    assert dataset.truth.image.tolist() == [2]


@pytest.mark.parametrize("field", ["file_name", "width", "height"])
def test_a_picture_that_is_to_be_looked_at_has_a_file_and_a_size(tmp_path, field):
    content = images(tmp_path, ["one/0.png"])
    del content["images"][0][field]
    with pytest.raises(InputError, match=rf"truth.json images.id=5.{field}: found nothing"):
        read(tmp_path, content)


def test_joined_sets_keep_their_boxes_and_get_names_of_their_own(folder):
    one, _ = read(folder, document())
    both = joined([one, one])
    assert [(q.name, q.first) for q in both.sequences] == [("a", 0), ("a-2", 10)]
    assert both.truth.image.tolist() == list(range(20))
    assert both.sha256 != one.sha256


def test_the_content_decides_the_hash(folder):
    first = read(folder, document())[0]
    assert read(folder, document())[0].sha256 == first.sha256
    write_video(folder / "a.mp4", 30, rate=25)
    assert read(folder, document())[0].sha256 != first.sha256


def test_scaling_takes_boxes_and_areas_along(folder):
    dataset, _ = read(folder, document())
    truth, factors = scaled(dataset.truth, dataset.pictures, (128, 96))
    assert truth.bbox[0].tolist() == [20, 20, 40, 60]
    assert truth.area[0] == 2400
    assert (factors == 2.0).all()


def test_a_size_that_would_distort_is_refused(folder):
    dataset, _ = read(folder, document())
    require_aspect(dataset, (128, 96))
    with pytest.raises(InputError, match="64 x 48"):
        require_aspect(dataset, (1024, 576))

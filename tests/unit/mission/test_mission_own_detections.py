"""Detections that a team has already: each row in its place or counted, in any order, and never guessed."""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from pipeline.config.fusion import ObjectClass
from pipeline.config.pool import Calibration
from pipeline.errors import InputError
from pipeline.geo.camera import Camera
from pipeline.ingest.trajectory import Trajectory
from pipeline.messages import CameraPose
from pipeline.mission.detection_files import read_listing
from pipeline.mission.frame_names import number_in, stream_of, time_in
from pipeline.mission.listed_frames import Listing
from pipeline.mission.own_detections import OwnDetector, PlacedDetections, looked_at_all, place
from pipeline.mission.picture_finder import FilmedStream, Numbering

START_NS = 1_781_429_400_000_000_000  # 2026-06-14 09:30:00 UTC
PERSON = cast("ObjectClass", ObjectClass.model_construct(id=0, name="person"))
VEHICLE = cast("ObjectClass", ObjectClass.model_construct(id=3, name="vehicle"))
HEAD = "stream,frame,x,y,w,h,score,class\n"


class Hover:
    """A trajectory that stands still, without a pose from 2.5 s on."""

    clock = "utc"

    def pose(self, time_s: float) -> CameraPose | None:
        return CameraPose(np.zeros(3), np.eye(3)) if time_s < 2.5 else None

    def utc_ns(self, time_s: float) -> int:
        return START_NS + round(time_s * 1e9)


def filmed(*names: str) -> list[FilmedStream]:
    camera = Camera(640, 480, 500.0, 500.0, 320.0, 240.0)
    times_s = np.arange(30) * 0.1
    return [FilmedStream(n, f"{n.upper()}.MP4", times_s, cast("Trajectory", Hover()), camera) for n in names]


def listed(tmp_path: Path, text: str) -> Listing:
    path = tmp_path / "dets.csv"
    path.write_text(text, encoding="utf-8")
    return read_listing(path)


def placed(listing: Listing, *streams: str, **stated: Any) -> PlacedDetections:
    stated.setdefault("min_score", 0.0)
    return place(listing, filmed(*(streams or ("one", "two"))), (PERSON, VEHICLE), OwnDetector(**stated))


def coco(tmp_path: Path, results: Any, images: Any = None) -> Listing:
    path, beside = tmp_path / "results.json", None
    path.write_text(json.dumps(results))
    if images is not None:
        beside = tmp_path / "images.json"
        beside.write_text(json.dumps(images))
    return read_listing(path, beside)


def result(
    image: Any, box: Sequence[float] = (10, 20, 30, 40), category: int = 1, score: float = 0.5
) -> dict[str, Any]:
    return {"image_id": image, "category_id": category, "bbox": list(box), "score": score}


@pytest.mark.parametrize(
    ("head", "cells"),
    [
        ("stream,frame,x,y,w,h,score,class", "one,7,10,20,30,40,0.5,person"),
        ("Stream;Frame;X0;Y0;X1;Y1;Confidence;Label", "one;7;10;20;40;60;0,5;person"),
        ("video,time,xmin,ymin,xmax,ymax,conf,category", "ONE.MP4,0.70,10,20,40,60,0.5,Person"),
        ("video,time(ms),left,top,width,height,conf,category", "one,701,10,20,30,40,0.5,PERSON"),
        ("file,xc,yc,w,h,score,class", "frames/one_000007.jpg,25,40,30,40,0.5,person"),
        ("image_id,x,y,w,h,score,class", "one_t0.7.png,10,20,30,40,0.5,person"),
        ("stream,time,x,y,w,h,score,class", "one,2026-06-14T09:30:00.7Z,10,20,30,40,50,person"),
        ("stream,time,x,y,w,h,score,class", "one,1781429400.7,10,20,30,40,0.5,person"),
        ("stream,frame,x,y,w,h,score", "one,7,0.015625,0.0416666667,0.046875,0.0833333333,0.5"),
    ],
)
def test_every_way_to_write_a_box_gives_the_same_result(tmp_path: Path, head: str, cells: str) -> None:
    (found,) = placed(
        listed(tmp_path, f"{head}\n{cells}\n{cells}\n".replace("\n" + cells, "\n" + cells, 1))
    ).detections
    assert (found.stream, found.index, found.time_ns) == ("one", 7, START_NS + 700_000_000)
    assert np.allclose(found.boxes_px, [[10, 20, 40, 60]])
    assert found.scores.tolist() == [0.5]
    assert found.class_ids.tolist() == [0]


def test_the_order_of_rows_does_not_matter(tmp_path: Path) -> None:
    chance = random.Random(3)
    rows = [
        f"{chance.choice(['one', 'two'])},{chance.randrange(20)},{chance.randrange(300)},9,8,7,0.5,person"
        for _ in range(90)
    ]
    first = placed(listed(tmp_path, HEAD + "\n".join(rows))).detections
    chance.shuffle(rows)
    second = placed(listed(tmp_path, HEAD + "\n".join(rows))).detections
    assert [d.order for d in first] == [d.order for d in second]
    assert all(np.array_equal(a.boxes_px, b.boxes_px) for a, b in zip(first, second, strict=True))


def test_only_what_is_listed_was_looked_at(tmp_path: Path) -> None:
    """A row without a box is a look that found nothing; a frame without a row is no look."""
    found = placed(listed(tmp_path, HEAD + "one,3,10,20,30,40,0.5,person\none,5,,,,,,\n")).detections
    assert [(d.index, len(d.scores)) for d in found] == [(3, 1), (5, 0)]


FAULTS = {
    "three,3,10,20,30,40,0.5,person": "unknown stream",
    "one,31,10,20,30,40,0.5,person": "outside of the video",
    "one,-1,10,20,30,40,0.5,person": "outside of the video",
    "one,27,10,20,30,40,0.5,person": "no_pose",
    "one,3,900,20,30,40,0.5,person": "box outside of the picture",
    "one,2,10,20,30,40,0.5,person": "repeated row",
    "one,3,10,20,30,,0.5,person": "no box of four numbers",
    "one,3,10,20,30,40,,person": "no score between 0 and 1",
    "one,3,10,20,30,40,x,person": "no score between 0 and 1",
    "one,3.5,10,20,30,40,0.5,person": "a frame that is no whole number",
    "one,,10,20,30,40,0.5,person": "neither frame nor time",
    "one,3,10,20,30,40,0.5,kite": "class 'kite' without a layer",
    "one,3,10,20,30,40,0.1,person": "score below 0.2",
    "one,3,10,20,30,40,0.5,person,9,9": "surplus cells",
}


@pytest.mark.parametrize("row", FAULTS)
def test_a_row_that_cannot_be_used_is_counted_and_named(tmp_path: Path, row: str) -> None:
    good = "one,2,10,20,30,40,0.5,person"
    listing = listed(tmp_path, HEAD + f"{good}\none,4,1,2,3,4,0.5,person\n{row}\n")
    assert sum(len(d.scores) for d in placed(listing, min_score=0.2).detections) == 2
    assert listing.left_out == {FAULTS[row]: 1}
    assert listing.first[FAULTS[row]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stream,frame,a,b,c,d,score\none,1,1,2,3,4,0.5\n", "no four columns of a box"),
        ("stream,frame,x,y,w,h\none,1,1,2,3,4\n", "no column score"),
        ("stream,x,y,w,h,score\none,1,2,3,4,0.5\n", "no column frame, time or file"),
        ("", "no row of samples"),
        ("{broken", "text that is not JSON"),
        ('{"images": []}', "no list of results"),
    ],
)
def test_a_file_that_lists_no_boxes_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        listed(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_labels_that_are_no_class_are_asked_about(tmp_path: Path) -> None:
    text = HEAD + "one,3,10,20,30,40,0.5,7\n"
    with pytest.raises(InputError, match="the classes '7'; expected --class LABEL=person"):
        placed(listed(tmp_path, text))
    (found,) = placed(listed(tmp_path, text), classes={"7": "vehicle"}).detections
    assert found.class_ids.tolist() == [3]
    with pytest.raises(InputError, match="no class 'boat'"):
        placed(listed(tmp_path, text), classes={"7": "boat"})


def test_scores_are_calibrated_as_stated(tmp_path: Path) -> None:
    listing = listed(tmp_path, HEAD + "one,3,10,20,30,40,0.5,person\n")
    (found,) = placed(listing, calibration=Calibration(scale=1.0, offset=1.0)).detections
    assert found.scores[0] == pytest.approx(1.0 / (1.0 + np.exp(-1.0)))


def test_numbers_that_reach_the_last_picture_show_that_they_count_from_one(tmp_path: Path) -> None:
    rows = "".join(f"one,{n},10,20,30,40,0.5,person\n" for n in (1, 24, 30))
    listing = listed(tmp_path, HEAD + rows)
    assert [d.index for d in placed(listing).detections] == [0, 23]
    assert any("numbered from 1" in sentence for sentence in listing.assumed)


def test_numbers_of_pictures_taken_at_another_rate_are_times(tmp_path: Path) -> None:
    listing = listed(tmp_path, HEAD + "one,1,10,20,30,40,0.5,person\none,4,10,20,30,40,0.5,person\n")
    assert [d.index for d in placed(listing, numbering=Numbering(1, 2.0)).detections] == [0, 15]
    listing = listed(tmp_path, HEAD + "".join(f"one,{n},10,20,30,40,0.5,person\n" for n in range(1, 9)))
    placed(listing)
    assert any("--frame-rate" in sentence for sentence in listing.assumed)


def test_boxes_of_smaller_pictures_are_scaled_if_said(tmp_path: Path) -> None:
    listing = listed(tmp_path, HEAD + "one,3,10,20,30,40,0.5,person\n")
    (found,) = placed(listing, picture_size=(320, 240)).detections
    assert found.boxes_px.tolist() == [[20, 40, 80, 120]]
    placed(listing, picture_size=(320, 200))
    assert listing.left_out == {"box of a picture of another shape": 1}


def test_boxes_of_two_frames_that_fall_on_one_picture_are_not_added_up(tmp_path: Path) -> None:
    rows = [f"one,{t},10,20,30,40,0.5,person" for t in (0.7, 0.74, 0.8)]
    for order in (rows, rows[::-1]):
        listing = listed(tmp_path, HEAD.replace("frame", "time") + "\n".join(order))
        assert [(d.index, len(d.scores)) for d in placed(listing).detections] == [(7, 1), (8, 1)]
        assert listing.left_out == {"another frame of the same picture": 1}
        assert listing.first["another frame of the same picture"].endswith(":3")


IMAGES = {
    "images": [
        {"id": 1, "file_name": "one/frame_000003.jpg", "width": 1280, "height": 960},
        {"id": 2, "file_name": "two/frame_000004.jpg"},
        {"id": 3, "file_name": "two/frame_000000.jpg"},
        {"id": 4, "file_name": "two/frame_000006.jpg", "width": 640, "height": 640},
    ],
    "categories": [{"id": 1, "name": "person"}, {"id": 2, "name": "vehicle"}],
}


def test_coco_results_go_to_frames_by_the_names_of_their_files(tmp_path: Path) -> None:
    listing = coco(
        tmp_path, [result(1), result(2, category=2), result(9), result(4), "x", result(2, (1, 2))], IMAGES
    )
    found = placed(listing).detections
    assert [(d.stream, d.index) for d in found] == [("one", 3), ("two", 4), ("two", 6)]
    assert found[0].boxes_px.tolist() == [[5, 10, 20, 30]]  # of a picture twice as large
    assert found[1].class_ids.tolist() == [3]
    assert listing.left_out == {
        "image id that is not among the images": 1,
        "box of a picture of another shape": 1,
        "no result": 1,
        "no box of four numbers": 1,
    }


def test_coco_images_without_a_result_are_looks_only_if_said(tmp_path: Path) -> None:
    listing = coco(tmp_path, [result(1)], IMAGES)
    assert [row.file for row in listing.pictures] == [
        "two/frame_000004.jpg",
        "two/frame_000000.jpg",
        "two/frame_000006.jpg",
    ]
    assert len(placed(listing).detections) == 1
    looked_at_all(listing)
    assert [(d.stream, d.index, len(d.scores)) for d in placed(listing).detections] == [
        ("two", 0, 0),
        ("one", 3, 1),
        ("two", 4, 0),
        ("two", 6, 0),
    ]


def test_coco_image_ids_may_be_file_names_but_not_bare_numbers(tmp_path: Path) -> None:
    (found,) = placed(coco(tmp_path, [result("one_0007.jpg")]), classes={"1": "person"}).detections
    assert (found.stream, found.index) == ("one", 7)
    with pytest.raises(InputError, match="image ids that are numbers; expected --images"):
        coco(tmp_path, [result(12)])


def test_coco_videos_with_frame_ids_go_by_these(tmp_path: Path) -> None:
    images = {
        "videos": [{"id": 5, "name": "two"}],
        "images": [{"id": 1, "file_name": "000000123456.jpg", "video_id": 5, "frame_id": 8}],
        "categories": IMAGES["categories"],
    }
    (found,) = placed(coco(tmp_path, [result(1)], images)).detections
    assert (found.stream, found.index) == ("two", 8)


@pytest.mark.parametrize(
    ("name", "stream", "number", "time_s"),
    [
        ("drone-1/frame_000123.jpg", "drone-1", 123, None),
        ("DJI_0001_000123.jpg", "drone-2", 123, None),
        ("drone-1.mp4#42", "drone-1", 42, None),
        ("drone-11_7.png", None, 7, None),
        ("out/drone-2_12.5s.jpg", "drone-2", 5, 12.5),
        ("drone-2_t3.25.png", "drone-2", 25, 3.25),
        ("drone-1_00-01-02.500.jpg", "drone-1", 500, 62.5),
        ("picture.jpg", None, None, None),
    ],
)
def test_names_of_files_tell_stream_number_and_time(
    name: str, stream: str | None, number: int | None, time_s: float | None
) -> None:
    keys = {"drone-1": "drone-1", "drone-2": "drone-2", "DJI_0001": "drone-2", "DJI_0001.MP4": "drone-2"}
    assert stream_of(name, keys) == stream
    key = next((k for k in sorted(keys, key=len, reverse=True) if k in name and stream), "")
    assert number_in(name, key) == number
    assert time_in(name, key) == time_s

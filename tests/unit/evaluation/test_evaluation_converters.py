from __future__ import annotations

import av
import numpy as np
import pytest

from pipeline.config.evaluation import FaultPolicy
from pipeline.errors import InputError
from pipeline.evaluation.datasets.converters import converted
from pipeline.evaluation.datasets.fault_log import FaultLog


def image(path, size=(64, 48)):
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w", format="image2") as container:
        stream = container.add_stream("mjpeg")
        stream.width, stream.height, stream.pix_fmt = *size, "yuvj420p"
        frame = av.VideoFrame.from_ndarray(np.zeros((size[1], size[0], 3), np.uint8), format="rgb24")
        container.mux(stream.encode(frame.reformat(format="yuvj420p")))
        container.mux(stream.encode(None))


def convert(kind, folder, policy=None):
    return converted(kind, folder, FaultLog(policy or FaultPolicy()))


@pytest.fixture
def mot(tmp_path):
    sequence = tmp_path / "MOT-01"
    for k in (1, 2):
        image(sequence / "img1" / f"{k:06}.jpg")
    (sequence / "seqinfo.ini").write_text("[Sequence]\nname=MOT-01\nimDir=img1\nseqLength=2\nframeRate=30\n")
    (sequence / "gt").mkdir()
    (sequence / "gt/gt.txt").write_text(
        "1,1,11,21,10,20,1,1,0.9\n"  # a person
        "2,1,12,21,10,20,0,1,1\n"  # not considered
        "2,2,1,1,5,5,1,7,1\n"  # static: neither right nor wrong
        "2,3,1,1,5,5,1,3,1\n"  # a car: left out
    )
    return tmp_path


def test_mot_counts_pixels_from_one_and_ignores_what_is_no_walking_person(mot):
    document = convert("mot", mot)
    assert [(i["file_name"], i["frame_id"]) for i in document["images"]] == [
        ("MOT-01/img1/000001.jpg", 1),
        ("MOT-01/img1/000002.jpg", 2),
    ]
    assert document["images"][0]["width"] == 64
    boxes = [(a["image_id"], a["bbox"], a["iscrowd"], a["visible_share"]) for a in document["annotations"]]
    assert boxes == [
        (1, [10, 20, 10, 20], 0, 0.9),
        (2, [11, 20, 10, 20], 1, 1.0),
        (2, [0, 0, 5, 5], 1, 1.0),
    ]
    assert convert("mot", mot / "MOT-01")["annotations"] == document["annotations"]


def test_a_mot_sequence_of_another_length_is_refused_or_counted(mot):
    (mot / "MOT-01/img1/000002.jpg").unlink()
    with pytest.raises(InputError, match="seqLength: found 2; expected 1"):
        convert("mot", mot)
    convert("mot", mot, FaultPolicy(frame_count="skip"))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1,1,x,1,5,5,1,1,1", "gt.txt:1: found"),
        ("1,1,2", "gt.txt:1: found 3 numbers"),
        ("1,1,1,1,0,5,1,1,1", "0 x 5"),
    ],
)
def test_a_line_that_is_no_box_is_named(mot, line, message):
    (mot / "MOT-01/gt/gt.txt").write_text(line + "\n")
    with pytest.raises(InputError, match=message):
        convert("mot", mot)


def test_visdrone_pictures(tmp_path):
    image(tmp_path / "images/a.jpg")
    (tmp_path / "annotations").mkdir()
    (tmp_path / "annotations/a.txt").write_text(
        "1,2,3,4,1,1,0,0\n5,6,7,8,1,2,0,1,\n0,0,30,30,0,0,0,0\n9,9,3,3,1,4,0,0\n9,9,3,3,0,1,0,0\n"
    )
    document = convert("visdrone", tmp_path)
    assert [(a["bbox"], a["iscrowd"]) for a in document["annotations"]] == [
        ([1, 2, 3, 4], 0),
        ([5, 6, 7, 8], 0),
        ([0, 0, 30, 30], 1),
        ([9, 9, 3, 3], 1),
    ]


def test_visdrone_sequences(tmp_path):
    for k in (1, 2):
        image(tmp_path / f"sequences/uav1/{k:07}.jpg")
    (tmp_path / "annotations").mkdir()
    (tmp_path / "annotations/uav1.txt").write_text(
        "1,0,1,2,3,4,1,1,0,0\n2,0,2,2,3,4,1,1,0,0\n3,0,2,2,3,4,1,1,0,0\n"
    )
    document = convert("visdrone", tmp_path)
    assert document["videos"] == [{"id": 1, "name": "uav1"}]
    # the third line names a frame without a picture: an id that no picture has
    assert [a["image_id"] for a in document["annotations"]] == [1, 2, -3]


@pytest.mark.parametrize("kind", ["mot", "visdrone"])
def test_a_folder_without_a_sequence_is_refused(tmp_path, kind):
    with pytest.raises(InputError, match="no"):
        convert(kind, tmp_path)
    with pytest.raises(InputError, match="no folder"):
        convert(kind, tmp_path / "absent")

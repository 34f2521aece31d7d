"""A COCO file's pictures by flight: as sequences in their order, only those that are asked for."""

from __future__ import annotations

import json

import numpy as np
import pytest
from matplotlib.image import imsave

from pipeline.config.evaluation import DataSetFile, Evaluation, Sequences
from pipeline.errors import InputError
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.evaluation.datasets.groups import in_sequences, of_groups
from pipeline.evaluation.datasets.read_datasets import read_datasets

ASKED = Sequences(by="flight", only=(2, 1), order="index")


def document(**changes) -> dict:
    """Flight 1 has pictures 3, 1, flight 2 one, flight 0 one; a person in each."""
    rows = [(1, 1, 3), (2, 0, 9), (3, 1, 1), (4, 2, 5)]
    images = [
        {"id": i, "file_name": f"{i}.png", "width": 64, "height": 48, "flight": flight, "index": index}
        for i, flight, index in rows
    ]
    images[0] |= changes
    box = {"category_id": 1, "bbox": [4, 4, 10, 20]}
    return {
        "images": images,
        "annotations": [box | {"id": i, "image_id": i} for i, _, _ in rows],
        "categories": [{"id": 1, "name": "person"}],
    }


def test_only_the_wanted_groups_and_their_boxes_stay():
    chosen = of_groups(document(), "flight", (1,), "x.json")
    assert [i["id"] for i in chosen["images"]] == [1, 3]
    assert [a["image_id"] for a in chosen["annotations"]] == [1, 3]


def test_sequences_are_read_in_their_order(tmp_path):
    for number in range(1, 5):
        imsave(tmp_path / f"{number}.png", np.full((48, 64, 3), number, np.uint8))
    (tmp_path / "labels.json").write_text(json.dumps(document()))
    source = DataSetFile(
        format="coco", path=tmp_path / "labels.json", sequences=ASKED, frame_rate={"hertz": 10}
    )
    evaluation = Evaluation.model_construct(datasets=(source,), categories=("person",), visible_min=0.3)
    from pipeline.config.evaluation import FaultPolicy

    dataset = read_datasets(evaluation, FaultLog(FaultPolicy()))
    files = {q.name: [f.name for f in q.files] for q in dataset.sequences}
    assert files == {"flight-1": ["3.png", "1.png"], "flight-2": ["4.png"]}
    assert all(q.frame_rate == 10.0 for q in dataset.sequences)
    assert len(dataset.truth) == 3


@pytest.mark.parametrize(
    ("content", "asked", "words"),
    [
        (document(), Sequences(by="flight", only=(7,), order="index"), "no image of flight 7; expected one of 0, 1, 2"),
        (document(), Sequences(by="pilot", only=(1,), order="index"), r"images\.0\.pilot: found None"),
        (document(index="c"), ASKED, r"images\.id=1\.index: found 'c'; expected a number"),
        (document(flight=[1]), ASKED, r"images\.0\.flight: found \[1\]"),
        ({"images": 3}, ASKED, "no images"),
        ([], ASKED, "no images"),
    ],
)  # fmt: skip
def test_what_cannot_be_told_apart_is_refused(content, asked, words):
    with pytest.raises(InputError, match=words):
        in_sequences(content, asked, "labels.json")


def test_sequences_are_of_coco_files_only():
    with pytest.raises(ValueError, match="mismatch"):
        DataSetFile(format="mot", path="x", sequences=ASKED)

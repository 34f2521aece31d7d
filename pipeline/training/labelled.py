"""Real pictures with COCO labels, put on disk as a training reads them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.config.evaluation import FaultPolicy
from pipeline.detection.picture_file import read_picture
from pipeline.errors import InputError
from pipeline.evaluation.datasets.coco import CocoOptions, dataset_of
from pipeline.evaluation.datasets.coco_format import parsed
from pipeline.evaluation.datasets.dataset import DataSet, sha256_of_file
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.evaluation.datasets.groups import of_groups
from pipeline.training.config import LabelledPictures
from pipeline.training.degradation import degrade
from pipeline.training.pictures import BITRATES_BPS, PictureSet, is_complete, open_recorded, picture_files

#: PictureSet.visible_shares of a region where nobody was counted: neither right nor wrong
_IGNORED, _WHOLE = 0.0, 1.0


def prepare_labelled(
    data: LabelledPictures, base: Path, folder: Path, copied: Callable[[int, int], None]
) -> PictureSet:
    """The pictures of all parts, written to folder if not there yet.

    base: the training file's folder. copied: called with how many pictures are done and how many there are.
    Raises InputError for labels or pictures that cannot be read, a group that is not there, and pictures of
    different sizes.
    """
    labels = base / data.labels
    plan = {
        "labels_sha256": sha256_of_file(labels) if labels.is_file() else None,
        "categories": list(data.categories),
        "groups": [data.split_by, *sorted(data.groups, key=str)],
    }
    if not is_complete(folder):
        chosen = of_groups(parsed(labels), data.split_by, data.groups, labels)
        root = labels.parent if data.folder is None else base / data.folder
        options = CocoOptions(root, data.categories, 0.0, None, False)
        dataset = dataset_of(chosen, labels, options, FaultLog(FaultPolicy()), "")
        _write(folder, dataset, chosen["images"], plan, copied)
    return open_recorded(folder, plan)


def part(pictures: PictureSet, data: LabelledPictures, groups: tuple[int | str, ...]) -> PictureSet:
    """The pictures of some groups, in the same files."""
    rows = [i for i, own in enumerate(pictures.attributes) if own[data.split_by] in groups]
    return replace(pictures, rows=np.array(rows, np.int64))


def _write(
    folder: Path, dataset: DataSet, images: list[Any], plan: Any, copied: Callable[[int, int], None]
) -> None:
    first = dataset.pictures[0]
    width, height = first.width, first.height
    total = len(dataset.pictures)
    clean, degraded = picture_files(folder, (total, height, width, 3))
    attributes = {i["file_name"]: i for i in images}
    entries = []
    for q in dataset.sequences:
        (number,), (file,) = q.pictures, q.files
        image = read_picture(file)
        if image.shape != (height, width, 3):
            found = f"a picture of {image.shape[1]} x {image.shape[0]}"
            raise InputError(file, found, f"{width} x {height}, as the first one is labelled")
        rng = np.random.default_rng([number, 3])
        bitrate_bps = float(np.exp(rng.uniform(*np.log(BITRATES_BPS))))
        clean[number], degraded[number] = image, degrade(image, bitrate_bps, rng)
        own = dataset.truth.image == number
        boxes, crowd = dataset.truth.bbox[own], dataset.truth.crowd[own]
        entries.append(
            {
                "boxes": np.hstack([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]]).tolist(),
                "visible": np.where(crowd, _IGNORED, _WHOLE).tolist(),
                "attributes": attributes[q.name],
            }
        )
        copied(number + 1, total)
    (folder / "people.json").write_text(json.dumps({"plan": plan, "people": entries}), encoding="utf-8")

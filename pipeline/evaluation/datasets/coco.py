"""COCO JSON to a data set; every fault in it is counted and named."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import InputError
from pipeline.evaluation.datasets.coco_format import CocoDocument, CocoId, parsed, validated
from pipeline.evaluation.datasets.coco_pictures import CocoPicture, pictures_of
from pipeline.evaluation.datasets.coco_rows import in_order, listed, places, unique
from pipeline.evaluation.datasets.dataset import DataSet, Picture, Sequence, sha256_of_file, sha256_of_texts
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.evaluation.metrics.boxes import true_boxes
from pipeline.ingest.video.file import open_video
from pipeline.sensor.expected_size import expected_person_px

#: a box may reach so far out of its picture: annotation tools round outwards
_EDGE_PX = 1.0
_PERSON = 1


@dataclass(frozen=True, slots=True)
class CocoOptions:
    """How a data set is read; see pipeline.config.evaluation."""

    root: Path
    categories: tuple[str, ...]
    visible_min: float
    frame_rate: float | None
    simulated: bool


def read_coco(path: Path, options: CocoOptions, faults: FaultLog) -> DataSet:
    """The data set of a COCO JSON file. Raises InputError for what cannot be read, or is refused."""
    return dataset_of(parsed(path), path, options, faults, sha256_of_file(path))


def dataset_of(document: Any, where: Path, options: CocoOptions, faults: FaultLog, sha256: str) -> DataSet:
    """The data set of a COCO document. where: for messages. sha256: of the annotations."""
    coco = validated(document, where)
    images = unique(coco.images, where, "images", faults)
    found = pictures_of(in_order(images), coco, where, options.root, options.frame_rate is None, faults)
    pictures = tuple(_picture(p) for p in found)
    sequences = _sequences(found, where, options)
    found, pictures, sequences = _within_videos(found, pictures, sequences, options, where, faults)
    number = {p.id: k for k, p in enumerate(found)}
    truth = _truth(coco, images, number, where, options, faults)
    sequences = tuple(replace(q, sha256=_sha256_of_files(q)) for q in sequences)
    digest = sha256_of_texts([sha256, *(q.sha256 for q in sequences)])
    return DataSet(pictures, sequences, truth, digest, options.simulated)


def _picture(place: CocoPicture) -> Picture:
    context = place.image.context
    expected = (
        None
        if context is None
        else expected_person_px(context.height_m, math.radians(context.pitch_deg), context.focal_px)
    )
    return Picture(place.frame, place.width, place.height, expected)


def _sequences(places: list[CocoPicture], where: Path, options: CocoOptions) -> tuple[Sequence, ...]:
    sequences: list[Sequence] = []
    first = 0
    for _, group in groupby(places, key=lambda p: p.sequence):
        mine = list(group)
        sequences.append(_sequence(mine, first, where, options))
        first += len(mine)
    return tuple(sequences)


def _sequence(places: list[CocoPicture], first: int, where: Path, options: CocoOptions) -> Sequence:
    name, files = places[0].sequence, tuple(dict.fromkeys(p.file for p in places))
    sizes = {(p.width, p.height) for p in places}
    if not places[0].in_video:
        if options.frame_rate is not None and len(sizes) > 1:
            raise InputError(
                f"{where} sequence {name}", f"pictures of {len(sizes)} sizes", "one size in a sequence"
            )
        # frames of files are numbered 0, 1, ..: what lies between annotated files is not known
        count = len(places)
        return Sequence(
            name, tuple(p.file for p in places), False, options.frame_rate, count, first, count, ""
        )
    if len(files) > 1:
        raise InputError(
            f"{where} sequence {name}", f"two videos: {files[0]}, {files[1]}", "one name for each video"
        )
    video = open_video(files[0])
    if sizes != {(video.width, video.height)}:
        size = sorted(sizes)[0]
        raise InputError(
            f"{where} images of {name}",
            f"pictures of {size[0]} x {size[1]}",
            f"the size of {files[0]}, {video.width} x {video.height}",
        )
    return Sequence(name, files, True, video.frame_rate, video.frames, first, len(places), "")


def _within_videos(
    places: list[CocoPicture],
    pictures: tuple[Picture, ...],
    sequences: tuple[Sequence, ...],
    options: CocoOptions,
    where: Path,
    faults: FaultLog,
) -> tuple[list[CocoPicture], tuple[Picture, ...], tuple[Sequence, ...]]:
    """Without the pictures beyond their video's end; files are numbered by their place in the sequence."""
    kept: list[int] = []
    frames: dict[int, int] = {}
    for q in sequences:
        own = [pictures[n].frame for n in q.pictures]
        if q.is_video:
            _check_frame_count(q, own, where, faults)
        for rank, n in enumerate(q.pictures):
            if not q.is_video or own[rank] < q.frames:
                kept.append(n)
                frames[n] = own[rank] if q.is_video else rank
    places = [places[n] for n in kept]
    renumbered = tuple(
        Picture(frames[n], pictures[n].width, pictures[n].height, pictures[n].expected_px) for n in kept
    )
    return places, renumbered, _sequences(places, where, options)


def _check_frame_count(sequence: Sequence, frames: list[int], where: Path, faults: FaultLog) -> None:
    """A video ends where its annotations do: within their usual step."""
    step = max(1, round(float(np.median(np.diff(frames))))) if len(frames) > 1 else 1
    annotated, beyond = frames[-1] + 1, sum(1 for frame in frames if frame >= sequence.frames)
    if beyond or (len(frames) > 1 and sequence.frames - annotated >= step):
        faults.report(
            "frame_count",
            f"{where} images of {sequence.name}",
            f"annotations up to frame {annotated - 1}, one in {step}",
            f"those of the {sequence.frames} frames of {sequence.files[0]}",
            count=max(beyond, 1),
        )


def _truth(
    coco: CocoDocument,
    images: dict[CocoId, Any],
    number: dict[CocoId, int],
    where: Path,
    options: CocoOptions,
    faults: FaultLog,
) -> Any:
    persons, rows = _person_ids(coco, where, options), []
    categories = unique(coco.categories, where, "categories", faults)
    annotations = places(coco.annotations, where, faults)
    for at, a in listed(annotations, images, categories, faults):
        if a.category_id in persons and a.image_id in number:
            width, height = images[a.image_id].width, images[a.image_id].height
            box = _inside(a.bbox, width, height)
            if box != a.bbox:
                found = f"{list(a.bbox)}, not within {width} x {height}"
                faults.report("outside_box", f"{at}.bbox", found, "x, y, width, height inside the picture")
            if box is not None:
                whole = a.area is not None and box == a.bbox
                area = a.area if whole else box[2] * box[3]
                ignored = bool(a.iscrowd or a.ignore or a.visible_share < options.visible_min)
                rows.append((number[a.image_id], _PERSON, box, area, ignored))
    return true_boxes(*zip(*rows, strict=True)) if rows else true_boxes([], [], [])


def _person_ids(coco: CocoDocument, where: Path, options: CocoOptions) -> set[CocoId]:
    ids = {c.id for c in coco.categories if c.name in options.categories}
    if not ids:
        names = ", ".join(c.name for c in coco.categories)
        raise InputError(f"{where} categories", names or "none", "one of " + ", ".join(options.categories))
    return ids


def _inside(
    box: tuple[float, float, float, float], width: int, height: int
) -> tuple[float, float, float, float] | None:
    """The box itself if it lies in the picture, else its part there; None if nothing is left."""
    x, y, w, h = box
    if not all(map(math.isfinite, box)) or w <= 0.0 or h <= 0.0:
        return None
    if min(x, y) >= -_EDGE_PX and x + w <= width + _EDGE_PX and y + h <= height + _EDGE_PX:
        return box
    left, top, right, bottom = max(x, 0.0), max(y, 0.0), min(x + w, width), min(y + h, height)
    return (left, top, right - left, bottom - top) if right > left and bottom > top else None


def _sha256_of_files(sequence: Sequence) -> str:
    return sha256_of_texts(sha256_of_file(file) for file in sequence.files)

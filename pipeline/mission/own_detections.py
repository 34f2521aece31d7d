"""Detections that a team has already, put in their place: stream, picture, pose, class.

A frame that is not listed is no look that found nothing. What cannot be used is counted, with the first place
where it was met.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.config.fusion import ObjectClass
from pipeline.config.pool import Calibration
from pipeline.errors import InputError
from pipeline.geo.camera import Camera
from pipeline.messages import Detections
from pipeline.mission.listed_frames import ListedRow, Listing, labels
from pipeline.mission.picture_finder import FilmedStream, Numbering, PictureFinder, first_number, stream_keys
from pipeline.sensor.calibration import calibrated

_Picture = tuple[str, int]
_Entry = tuple[float, tuple[float, ...], int]
#: the substream's detector
OWN = "own"
_ASPECT_TOLERANCE = 0.02


@dataclass(frozen=True)
class OwnDetector:
    """What is stated of a detector that we do not know.

    accuracy: relative to the best that the sensor model knows (the paper's p_det_rel), 0..1; calibration: what
    a score is worth; both None: assumed. min_score: boxes below are not used. classes: the file's label -> the
    mission's class. numbering: of the pictures. picture_size: width and height of the pictures that its boxes
    are of, where the file does not say it; None: the stream's own.
    """

    name: str = OWN
    accuracy: float | None = None
    calibration: Calibration | None = None
    min_score: float = 0.3
    classes: Mapping[str, str] = field(default_factory=dict)
    numbering: Numbering = field(default_factory=Numbering)
    picture_size: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class PlacedDetections:
    """detections: in order of time. not_fused: (stream, picture) -> why, of pictures that were listed in vain."""

    detections: tuple[Detections, ...]
    not_fused: Mapping[tuple[str, int], str]


def place(
    listing: Listing, streams: Sequence[FilmedStream], classes: Sequence[ObjectClass], detector: OwnDetector
) -> PlacedDetections:
    """The results of every picture that is listed. Counts and sentences are added to the listing.

    Raises InputError if no label is a class of the mission.
    """
    by_id = {s.stream: s for s in streams}
    class_ids = _class_ids(listing, classes, detector)
    finder = PictureFinder(
        listing,
        by_id,
        stream_keys(streams),
        first_number(listing, streams, detector.numbering),
        detector.numbering,
    )
    boxes: dict[_Picture, set[_Entry]] = defaultdict(set)
    shares = _are_shares(listing)
    for row, picture in _without_rivals(listing, [(row, finder.picture(row)) for row in listing.rows]):
        found = boxes[picture]
        box = _box(row, by_id[picture[0]].camera, listing, shares, detector)
        if box is None:
            continue
        if row.label not in class_ids:
            listing.leave_out(f"class {row.label!r} without a layer", row.where)
        elif row.score < detector.min_score:
            listing.leave_out(f"score below {detector.min_score:g}", row.where)
        elif (entry := (-row.score, box, class_ids[row.label])) in found:
            listing.leave_out("repeated row", row.where)
        else:
            found.add(entry)
    return _with_poses(boxes, by_id, listing, detector)


def _without_rivals(
    listing: Listing, rows: list[tuple[ListedRow, _Picture | None]]
) -> list[tuple[ListedRow, _Picture]]:
    """Rows that have a picture. Where boxes of two frames fall on one picture, those of the first frame stay."""
    placed = [(row, picture) for row, picture in rows if picture is not None]
    first: dict[_Picture, tuple[int, str, str]] = {}
    for row, picture in placed:
        if row.box is not None:
            first[picture] = min(first.get(picture, _frame_key(row)), _frame_key(row))
    kept = []
    for row, picture in placed:
        if row.box is not None and _frame_key(row) != first[picture]:
            listing.leave_out("another frame of the same picture", row.where)
        else:
            kept.append((row, picture))
    return kept


def _frame_key(row: ListedRow) -> tuple[int, str, str]:
    return (-1 if row.frame is None else row.frame, row.time, row.file)


def looked_at_all(listing: Listing) -> None:
    """Take every picture of the images file for looked at."""
    listing.rows += listing.pictures
    listing.pictures = []


def _with_poses(
    boxes: Mapping[_Picture, set[_Entry]],
    streams: Mapping[str, FilmedStream],
    listing: Listing,
    detector: OwnDetector,
) -> PlacedDetections:
    results, in_vain = [], {}
    for (stream, index), found in boxes.items():
        time_s = float(streams[stream].times_s[index])
        pose = streams[stream].trajectory.pose(time_s)
        if pose is None:
            listing.leave_out("no_pose", f"{stream} at {time_s:.2f} s")
            in_vain[stream, index] = "no_pose"
            continue
        # the order of rows in the file must not matter
        ordered = sorted(found)
        scores = np.array([-score for score, _, _ in ordered], np.float64)
        results.append(
            Detections(
                stream,
                OWN,
                index,
                streams[stream].trajectory.utc_ns(time_s),
                pose,
                np.array([box for _, box, _ in ordered], np.float64).reshape(-1, 4),
                scores if detector.calibration is None else calibrated(scores, detector.calibration),
                np.array([class_id for _, _, class_id in ordered], np.int64),
            )
        )
    return PlacedDetections(tuple(sorted(results, key=lambda r: r.order)), in_vain)


def _class_ids(listing: Listing, classes: Sequence[ObjectClass], detector: OwnDetector) -> dict[str, int]:
    """The mission's class id of each label of the file."""
    by_name = {c.name.lower(): c.id for c in classes}
    found: dict[str, int] = {}
    for label in labels(listing.rows):
        name = detector.classes.get(label, label if label else classes[0].name)
        if name.lower() in by_name:
            found[label] = by_name[name.lower()]
        elif label in detector.classes:
            raise InputError(f"--class {label}={name}", f"no class {name!r}", f"one of {', '.join(by_name)}")
    wanted = list(labels(listing.rows))
    if "" in found:
        listing.assumed.append(f"boxes without a class are of class {classes[0].name}")
    if wanted and not found:
        names = ", ".join(repr(label) for label in wanted[:8])
        raise InputError(
            "--detections", f"the classes {names}", f"--class LABEL={classes[0].name} for one of them"
        )
    return found


def _are_shares(listing: Listing) -> bool:
    """Whether boxes are shares of the picture: none reaches over 1, which no picture is so small for."""
    boxes = [row.box for row in listing.rows if row.box is not None]
    if not boxes or max(max(map(abs, box)) for box in boxes) > 1.5:
        return False
    listing.assumed.append("boxes are shares of the picture's width and height: none reaches beyond 1.5")
    return True


def _box(
    row: ListedRow, camera: Camera, listing: Listing, shares: bool, detector: OwnDetector
) -> tuple[float, ...] | None:
    """The box in pixels of the stream's picture; None if the row has none, or it is counted."""
    if row.box is None:
        return None
    size = row.size or detector.picture_size or (camera.width, camera.height)
    width, height = (1.0, 1.0) if shares else size
    if not shares and abs(width * camera.height / (height * camera.width) - 1.0) > _ASPECT_TOLERANCE:
        listing.leave_out("box of a picture of another shape", row.where)
        return None
    x_scale, y_scale = camera.width / width, camera.height / height
    box = tuple(v * scale for v, scale in zip(row.box, (x_scale, y_scale) * 2, strict=True))
    if box[2] <= 0.0 or box[3] <= 0.0 or box[0] >= camera.width or box[1] >= camera.height:
        listing.leave_out("box outside of the picture", row.where)
        return None
    return box

"""Detections that a team has already, put in their place: stream, picture, pose, class.

A frame that is not listed is no look that found nothing. What cannot be used is counted, with the first place
where it was met.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.config.mission import ObjectClass
from pipeline.config.pool import Calibration
from pipeline.errors import InputError
from pipeline.geo.camera import Camera
from pipeline.ingest.tables.dates import moment
from pipeline.ingest.trajectory import Trajectory
from pipeline.messages import Detections, FloatArray
from pipeline.mission.frame_names import key_in, number_in, stream_of, time_in
from pipeline.mission.listed_frames import ListedRow, Listing, labels
from pipeline.sensor.calibration import calibrated

#: the substream's detector
OWN = "own"
_ASPECT_TOLERANCE = 0.02
_EPOCH_S = 1e8


@dataclass(frozen=True)
class OwnDetector:
    """What is stated of a detector that we do not know.

    accuracy: relative to the best that the sensor model knows (the paper's p_det_rel), 0..1; calibration: what
    a score is worth; both None: assumed. min_score: boxes below are not used. classes: the file's label -> the
    mission's class. first_frame: the number of the video's first picture. frame_rate: Hz at which the pictures
    were taken from the video, if their numbers count these; None: they count the video's own pictures.
    """

    name: str = OWN
    accuracy: float | None = None
    calibration: Calibration | None = None
    min_score: float = 0.3
    classes: Mapping[str, str] = field(default_factory=dict)
    first_frame: int | None = None
    frame_rate: float | None = None


@dataclass(frozen=True, eq=False)
class FilmedStream:
    """times_s: presentation time of every picture, increasing. video: its file's name."""

    stream: str
    video: str
    times_s: FloatArray
    trajectory: Trajectory
    camera: Camera


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
    placed = _Placing(listing, by_id, _keys(streams), _first_number(listing, streams, detector), detector)
    boxes: dict[tuple[str, int], set[tuple[float, tuple[float, ...], int]]] = defaultdict(set)
    shares = _are_shares(listing)
    for row in listing.rows:
        picture = placed.picture(row)
        if picture is None:
            continue
        found = boxes[picture]
        box = _box(row, by_id[picture[0]].camera, listing, shares)
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


def looked_at_all(listing: Listing) -> None:
    """Take every picture of the images file for looked at."""
    listing.rows += listing.pictures
    listing.pictures = []


def _with_poses(
    boxes: Mapping[tuple[str, int], set[tuple[float, tuple[float, ...], int]]],
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


@dataclass(frozen=True, eq=False)
class _Placing:
    """Finds the picture of a row; what it cannot find it counts."""

    listing: Listing
    streams: Mapping[str, FilmedStream]
    keys: Mapping[str, str]
    first_number: int
    detector: OwnDetector

    def picture(self, row: ListedRow) -> tuple[str, int] | None:
        stream = self._stream(row)
        if stream is None:
            self.listing.leave_out("unknown stream", row.where)
            return None
        index = self._index(row, self.streams[stream])
        if isinstance(index, str):
            self.listing.leave_out(index, row.where)
            return None
        return stream, index

    def _stream(self, row: ListedRow) -> str | None:
        if row.stream:
            by_name = {key.lower(): stream for key, stream in self.keys.items()}
            return by_name.get(row.stream.lower())
        return stream_of(row.file, self.keys)

    def _index(self, row: ListedRow, filmed: FilmedStream) -> int | str:
        """The number of the picture in the video, or why there is none."""
        key = key_in(row.file, self.keys)
        if row.time:
            time_s = self._time_s(row.time, filmed)
            return "a time that cannot be read" if time_s is None else _nearest(filmed.times_s, time_s)
        if row.frame is None and row.file and (named_s := time_in(row.file, key)) is not None:
            return _nearest(filmed.times_s, named_s)
        number = row.frame if row.frame is not None else number_in(row.file, key)
        if number is None:
            return "neither number nor time in the file's name"
        number -= self.first_number
        if self.detector.frame_rate is not None:
            return _nearest(filmed.times_s, number / self.detector.frame_rate)
        return number if 0 <= number < len(filmed.times_s) else "outside of the video"

    def _time_s(self, text: str, filmed: FilmedStream) -> float | None:
        """Seconds of the video: as they are, or of a date."""
        try:
            value = float(text)
        except ValueError:
            read = moment(text, month_first=False)
            if (
                read is None
                or read.day_ns is None
                or read.of_day_ns is None
                or filmed.trajectory.clock == "unknown"
            ):
                return None
            date_ns = read.day_ns + read.of_day_ns - (read.utc_offset_ns or 0)
            return (date_ns - filmed.trajectory.utc_ns(0.0)) * 1e-9
        if value < _EPOCH_S:
            return value
        digits = 9 if value < 1e11 else 6 if value < 1e14 else 3 if value < 1e17 else 0
        return (round(value * 10**digits) - filmed.trajectory.utc_ns(0.0)) * 1e-9


def _nearest(times_s: FloatArray, time_s: float) -> int | str:
    """The picture that is nearest to a time, if one is within six tenths of the usual distance."""
    if not math.isfinite(time_s):
        return "a time that cannot be read"
    index = int(np.argmin(np.abs(times_s - time_s)))
    usual_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.1
    if abs(float(times_s[index]) - time_s) <= 0.6 * usual_s:
        return index
    outside = not times_s[0] <= time_s <= times_s[-1]
    return "outside of the video" if outside else "no picture at that time"


def _keys(streams: Sequence[FilmedStream]) -> dict[str, str]:
    """What may stand for a stream; a video's name that two streams share stands for none."""
    keys: dict[str, str] = {}
    for s in streams:
        for name in {s.video, s.video.rpartition(".")[0]} - {""}:
            keys[name] = "" if name in keys else s.stream
    keys = {name: stream for name, stream in keys.items() if stream}
    return keys | {s.stream: s.stream for s in streams}


def _first_number(listing: Listing, streams: Sequence[FilmedStream], detector: OwnDetector) -> int:
    """0 or 1: stated, or shown by the numbers themselves, or assumed."""
    if detector.first_frame is not None:
        return detector.first_frame
    keys = _keys(streams)
    rows = [row for row in (*listing.rows, *listing.pictures) if not row.time]
    read = [
        row.frame if row.frame is not None else number_in(row.file, key_in(row.file, keys)) for row in rows
    ]
    numbers = {n for n in read if n is not None}
    if not numbers or 0 in numbers:
        return 0
    longest = max(len(s.times_s) for s in streams)
    if detector.frame_rate is None and longest in numbers:
        listing.assumed.append(f"frames are numbered from 1: the last of the video, {longest}, is listed")
        return 1
    listing.assumed.append("frames are numbered from 0 (else: --first-frame 1)")
    if (
        detector.frame_rate is None
        and max(numbers) < 0.7 * longest
        and max(numbers) - min(numbers) < 2 * len(numbers)
    ):
        listing.assumed.append(
            f"frame numbers, up to {max(numbers)}, count the video's own {longest} pictures (else: --frame-rate)"
        )
    return 0


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


def _box(row: ListedRow, camera: Camera, listing: Listing, shares: bool) -> tuple[float, ...] | None:
    """The box in pixels of the stream's picture; None if the row has none, or it is counted."""
    if row.box is None:
        return None
    width, height = (1.0, 1.0) if shares else row.size or (camera.width, camera.height)
    if not shares and abs(width * camera.height / (height * camera.width) - 1.0) > _ASPECT_TOLERANCE:
        listing.leave_out("box of a picture of another shape", row.where)
        return None
    x_scale, y_scale = camera.width / width, camera.height / height
    box = tuple(v * scale for v, scale in zip(row.box, (x_scale, y_scale) * 2, strict=True))
    if box[2] <= 0.0 or box[3] <= 0.0 or box[0] >= camera.width or box[1] >= camera.height:
        listing.leave_out("box outside of the picture", row.where)
        return None
    return box

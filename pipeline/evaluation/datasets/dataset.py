"""Annotated pictures in sequences, whatever format they came in."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.evaluation.metrics.boxes import IntArray, TrueBoxes
from pipeline.ingest.sampling import sampled_indices
from pipeline.messages import FloatArray


@dataclass(frozen=True, slots=True)
class Picture:
    """One annotated picture. frame: its number in the video or in the sequence of files.

    width, height: pixels, as annotated. expected_px: expected size of a person, None if not known (see
    ``pipeline.evaluation.expected_size_classes``).
    """

    frame: int
    width: int
    height: int
    expected_px: float | None = None


@dataclass(frozen=True, slots=True)
class Sequence:
    """Pictures that follow each other. files: one video, or one image file for each frame.

    frame_rate: Hz, None for images without one: such a sequence cannot be transcoded. frames: in all,
    annotated or not. first: number of its first annotated picture in the data set; count: how many it has.
    sha256: of the files.
    """

    name: str
    files: tuple[Path, ...]
    is_video: bool
    frame_rate: float | None
    frames: int
    first: int
    count: int
    sha256: str

    @property
    def pictures(self) -> range:
        """Numbers of its annotated pictures."""
        return range(self.first, self.first + self.count)


@dataclass(frozen=True, eq=False)
class DataSet:
    """pictures: numbered through, by sequence and frame. truth: boxes of one category, 1, in their pixels.

    sha256: of all annotations and files. simulated: whether any of it is rendered. notes: what was left out.
    """

    pictures: tuple[Picture, ...]
    sequences: tuple[Sequence, ...]
    truth: TrueBoxes
    sha256: str
    simulated: bool
    notes: tuple[str, ...] = ()


def joined(sets: Iterable[DataSet]) -> DataSet:
    """Several data sets as one."""
    sets = tuple(sets)
    offsets = np.cumsum([0, *(len(s.pictures) for s in sets)])
    sequences: list[Sequence] = []
    columns = []
    for one, offset in zip(sets, offsets, strict=False):
        sequences += [replace(q, first=q.first + int(offset)) for q in one.sequences]
        t = one.truth
        columns.append((t.image + offset, t.category, t.bbox, t.area, t.crowd))
    return DataSet(
        tuple(p for s in sets for p in s.pictures),
        tuple(_named_apart(sequences)),
        TrueBoxes(*(np.concatenate(c) for c in zip(*columns, strict=True))),
        sha256_of_texts(s.sha256 for s in sets),
        any(s.simulated for s in sets),
        tuple(n for s in sets for n in s.notes),
    )


def _named_apart(sequences: list[Sequence]) -> Iterable[Sequence]:
    """The same sequences; a name that comes again gets a number."""
    seen: dict[str, int] = {}
    for q in sequences:
        seen[q.name] = seen.get(q.name, 0) + 1
        yield q if seen[q.name] == 1 else replace(q, name=f"{q.name}-{seen[q.name]}")


def kept_frames(sequence: Sequence, frame_rate_hz: float) -> IntArray:
    """The frames that are encoded: at the given rate, or all if the sequence is slower."""
    if sequence.frame_rate is None:
        raise InputError(
            f"sequence {sequence.name}",
            "images without a frame rate, which cannot be transcoded",
            "datasets.frame_rate, or no transcoding",
        )
    interval_s = 1.0 / sequence.frame_rate
    times_s = np.arange(sequence.frames, dtype=np.float64) * interval_s
    rate_hz = min(frame_rate_hz, sequence.frame_rate)
    # 1e-6 of a picture: a tick that falls on a picture must not be rounded to the one before
    return sampled_indices(times_s, rate_hz, 1e-6 * interval_s, interval_s)


def sampled_pictures(
    dataset: DataSet, sequence: Sequence, rate_hz: float, kept: IntArray | None = None
) -> list[int]:
    """Numbers of the annotated pictures to look at: for each tick k / rate the first one at or after it.

    Two ticks never share a picture; a tick without one before the next tick has none. kept: only among these
    frames. Images without a frame rate are all looked at.
    """
    among = None if kept is None else set(kept.tolist())
    numbers = [n for n in sequence.pictures if among is None or dataset.pictures[n].frame in among]
    if sequence.frame_rate is None:
        return numbers
    step = max(sequence.frame_rate / rate_hz, 1.0)
    chosen: dict[int, int] = {}
    for n in numbers:
        # 1e-6 of a frame: one that falls on a tick belongs to it
        chosen.setdefault(int(dataset.pictures[n].frame / step + 1e-6), n)
    return list(chosen.values())


def scaled(
    truth: TrueBoxes, pictures: tuple[Picture, ...], size: tuple[int, int] | None
) -> tuple[TrueBoxes, FloatArray]:
    """The truth in pictures of another size (width, height), and the factors (I, 2) along x and y.

    size None: as it is. COCO's size classes go by the new pixels.
    """
    factors = np.ones((len(pictures), 2))
    if size is not None:
        factors = np.array([(size[0] / p.width, size[1] / p.height) for p in pictures]).reshape(-1, 2)
    own = factors[truth.image]
    return (
        TrueBoxes(
            truth.image,
            truth.category,
            truth.bbox * np.hstack([own, own]),
            truth.area * own.prod(axis=1),
            truth.crowd,
        ),
        factors,
    )


def require_aspect(dataset: DataSet, size: tuple[int, int]) -> None:
    """Raises InputError if a picture would be distorted by more than 1 %."""
    for q in dataset.sequences:
        picture = dataset.pictures[q.first]
        ratio = picture.width * size[1] / (picture.height * size[0])
        if not 0.99 <= ratio <= 1.01:
            raise InputError(
                f"sequence {q.name}",
                f"pictures of {picture.width} x {picture.height}",
                f"the aspect of transcoding.width, height: {size[0]} x {size[1]}",
            )


def sha256_of_file(path: Path) -> str:
    """Of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sha256_of_texts(texts: Iterable[str]) -> str:
    """Of texts, one after the other, each ended."""
    digest = hashlib.sha256()
    for text in texts:
        digest.update(text.encode("utf-8") + b"\0")
    return digest.hexdigest()

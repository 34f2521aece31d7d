"""The pool: every detector that may be used, how accurate it is at which bitrate, how long it takes where."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from pipeline.config.base import Strict, load, mismatch, refuse_repeated
from pipeline.config.layout import Layout
from pipeline.config.units import Bitrate, Bytes, PositiveSeconds
from pipeline.errors import InputError
from pipeline.link.codec import Codec

TileSide = Annotated[int, Field(ge=32, le=16384)]
Accuracy = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]


class AccuracyAt(Strict):
    """Accuracy (AP .5 unless the provenance says otherwise) on video of this bitrate."""

    bitrate: Bitrate
    """Of the video. Example: `{mbps: 1}`."""
    accuracy: Accuracy
    """AP .5 unless the provenance says otherwise. Example: `0.9`."""


class AccuracyOfSize(AccuracyAt):
    """Accuracy for people of one of COCO's size classes."""

    size: Literal["small", "medium", "large"]
    """Up to 32, up to 96 and above 96 pixels square."""


class AccuracyWithCodec(AccuracyAt):
    """Accuracy under one codec."""

    codec: Codec
    """Of the video."""
    low: Accuracy | None = None
    """Of the 95 % interval. Example: `0.87`."""
    high: Accuracy | None = None
    """Of the 95 % interval. Example: `0.93`."""
    obtained: Bitrate | None = None
    """The bitrate that the encoder made of it. Example: `{kbps: 980}`."""
    largest_packet: PositiveSeconds | None = None
    """How long a link of the bitrate asked for needs for it. Example: `{milliseconds: 400}`."""


class AccuracyInContext(AccuracyAt):
    """Accuracy where a standing person is expected to be so large."""

    person_px_from: float = Field(ge=0.0)
    """The root of a person's box's area, pixels. Example: `16`."""
    person_px_below: float | None = Field(default=None, gt=0.0)
    """The same, below; absent: without limit. Example: `32`."""


class Sharing(Strict):
    """Detectors that share a machine."""

    detectors: int = Field(ge=2)
    """So many. Example: `2`."""
    factor: float = Field(ge=1.0)
    """How many times as long a frame takes then. Example: `1.2`."""


class TimeOn(Strict):
    """Execution time per frame on one machine type, as it was set up there."""

    machine: str
    """The type, as inventories name it. Example: `workstation`."""
    mean: PositiveSeconds
    """Of its frames. Example: `{milliseconds: 5.2}`."""
    maximum: PositiveSeconds | None = None
    """What plans are made with; absent: the mean. At least the mean. Example: `{milliseconds: 8}`."""
    minimum: PositiveSeconds | None = None
    """The fastest frame. Example: `{milliseconds: 5}`."""
    p95: PositiveSeconds | None = None
    """19 of 20 frames take no longer. Example: `{milliseconds: 6}`."""
    provider: str | None = None
    """What it ran on. Example: `cpu`."""
    threads: int | None = Field(default=None, ge=1)
    """That it ran with. Example: `1`."""

    @model_validator(mode="after")
    def _maximum_is_not_below_mean(self) -> TimeOn:
        if self.maximum is not None and self.maximum < self.mean:
            raise mismatch(f"{self.maximum:g} s", f"at least the mean, {self.mean:g} s", ("maximum",))
        return self


class Calibration(Strict):
    """What a score s is worth: the probability 1 / (1 + exp(-(scale log(s / (1 - s)) + offset)))."""

    scale: float = Field(gt=0.0, allow_inf_nan=False)
    """Above 0. Example: `3.78`."""
    offset: float = Field(allow_inf_nan=False)
    """Of the log-odds. Example: `-0.62`."""


class Tiles(Strict):
    """A picture in overlapping tiles."""

    size: tuple[TileSide, TileSide]
    """Width and height in pixels of the picture. Example: `[1024, 576]`."""
    overlap: float = Field(default=0.2, ge=0.0, le=0.9)
    """Of neighbours, a share of a tile; it should hold the largest person that is looked for in tiles."""
    whole: bool = False
    """And one pass over the whole picture, for those who are larger."""


class FoundOfSize(Strict):
    """The share of people of one size that is found in a single picture."""

    person_px_from: float = Field(ge=0.0)
    """Least size: the root of the box's area, in pixels of the evaluation's pictures. Example: `24`."""
    person_px_below: float | None = Field(default=None, gt=0.0)
    """Sizes from here on are others'. Absent: no end. Example: `32`."""
    share: Accuracy
    """Of the people of this size. Example: `0.9`."""
    people: int = Field(ge=1)
    """That it was measured on. Example: `120`."""


class OperatingPoint(Strict):
    """What the boxes above the score threshold are worth under one codec and bitrate."""

    codec: Codec
    """Of the video."""
    bitrate: Bitrate
    """Of the video. Example: `{kbps: 500}`."""
    picture_width: int = Field(ge=1)
    """Of the evaluation's pictures, pixels. Example: `1024`."""
    calibration: Calibration | None = None
    """Of the scores there; absent where there were too few boxes."""
    found: tuple[FoundOfSize, ...] = ()
    """People found, by size."""
    false_boxes: float = Field(ge=0.0, allow_inf_nan=False)
    """In a picture, on average. Example: `0.1`."""


class PoolDetector(Strict):
    """One detector."""

    id: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    """Letters, digits, `_`, `.`, `-`. Example: `small`."""
    model: Path | None = None
    """The ONNX file; none for a detector that is only planned with. Example: `small.onnx`."""
    card: Path | None = None
    """Its data sheet. Example: `small.md`."""
    memory: Bytes
    """That it needs. Example: `{megabytes: 45}`."""
    score_threshold: Accuracy = 0.3
    """Detections below it are not reported."""
    calibration: Calibration | None = None
    """What a score above the threshold is worth; absent: the score itself."""
    accuracy: tuple[AccuracyAt, ...] = Field(min_length=1)
    """Under the codec and by the metric that the provenance names; the other accuracies say more of the same."""
    times: tuple[TimeOn, ...] = Field(min_length=1)
    """On each machine type that it may run on."""
    sharing: tuple[Sharing, ...] = ()
    """How detectors on one machine slow each other down."""
    accuracy_by_size: tuple[AccuracyOfSize, ...] = ()
    """By the size of people."""
    accuracy_by_codec: tuple[AccuracyWithCodec, ...] = ()
    """By codec."""
    accuracy_by_context: tuple[AccuracyInContext, ...] = ()
    """By the size that people are expected to have."""
    operating_points: tuple[OperatingPoint, ...] = ()
    """What its boxes are worth at each bitrate. Absent: the map goes by accuracy alone."""
    layout: str | Layout | None = None
    """How the file is read: a built-in layout's name, or a description ([detectors.md](detectors.md)). Absent:
    found out. Example: `yolov8`.
    """
    names: tuple[str, ...] | Literal["coco", "coco91"] | None = None
    """Of its classes, in order, where the file does not say them; `coco`, `coco91`: COCO's. Example:
    `[pedestrian, boat]`.
    """
    classes: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """Which of its classes are which layer of the map. Example: `{person: [pedestrian, people]}`."""
    input_size: tuple[TileSide, TileSide] | None = None
    """Width and height, for a network that leaves them free. Example: `[640, 384]`."""
    tiles: Tiles | None = None
    """How its pictures are cut; accuracy, times and memory are of all tiles of a picture together."""
    precision: Literal["float32", "float16", "int8"] | None = None
    """Of its weights, as stated."""
    assumed: str | None = None
    """What of this row was not measured, in words; repeated wherever the detector is used. Example: `accuracy,
    as that of small`.
    """
    sha256: str | None = Field(default=None, pattern=r"^[0-9a-f]{64}$")
    """Of the model; a file with another one is refused. Example:
    `39a8cc606af2327e5a7a3f24c5d2e27d3d2f40b7deaa6163e97647a17587153d`.
    """

    @property
    def best_accuracy(self) -> float:
        """At whichever bitrate it is best, 0..1."""
        return max(row.accuracy for row in self.accuracy)

    def require_model(self, where: object) -> Path:
        """The ONNX file. where: for the message of the InputError if there is none."""
        if self.model is None:
            raise InputError(where, "nothing", "an ONNX file: this detector can only be planned with")
        return self.model

    @model_validator(mode="after")
    def _rows_are_unique(self) -> PoolDetector:
        refuse_repeated("bitrate", [row.bitrate for row in self.accuracy], at="accuracy")
        refuse_repeated("number of detectors", [row.detectors for row in self.sharing], at="sharing")
        of_size = [(row.size, row.bitrate) for row in self.accuracy_by_size]
        refuse_repeated("size and bitrate", of_size, at="accuracy_by_size")
        with_codec = [(row.codec, row.bitrate) for row in self.accuracy_by_codec]
        refuse_repeated("codec and bitrate", with_codec, at="accuracy_by_codec")
        in_context = [(row.person_px_from, row.bitrate) for row in self.accuracy_by_context]
        refuse_repeated("context and bitrate", in_context, at="accuracy_by_context")
        operating = [(row.codec, row.bitrate) for row in self.operating_points]
        refuse_repeated("codec and bitrate", operating, at="operating_points")
        refuse_repeated("machine type", [row.machine for row in self.times], at="times")
        return self


class Pool(Strict):
    """The detectors that may be used, and where the numbers come from."""

    detectors: tuple[PoolDetector, ...] = Field(min_length=1)
    """One or more."""
    provenance: dict[str, Any] = Field(default_factory=dict)
    """How they were measured; free keys. Example: `{machine: "AMD EPYC, 2 cores"}`."""
    assumed: tuple[str, ...] = ()
    """What of the pool was not measured, in words. Example: `[onboard is 6 times as slow]`."""

    @model_validator(mode="after")
    def _names_are_unique(self) -> Pool:
        refuse_repeated("detector", [detector.id for detector in self.detectors], at="detectors")
        return self


def load_pool(path: Path) -> Pool:
    """Read and validate a pool file; model and card paths come back resolved against the file."""
    pool = load(path, Pool)
    base = path.parent
    return pool.model_copy(
        update={
            "detectors": tuple(
                d.model_copy(
                    update={
                        "model": None if d.model is None else base / d.model,
                        "card": None if d.card is None else base / d.card,
                    }
                )
                for d in pool.detectors
            )
        }
    )

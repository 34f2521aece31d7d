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
    accuracy: Accuracy


class AccuracyOfSize(AccuracyAt):
    """Accuracy for people of one of COCO's size classes: up to 32, up to 96 and above 96 pixels square."""

    size: Literal["small", "medium", "large"]


class AccuracyWithCodec(AccuracyAt):
    """Accuracy under one codec. low, high: 95 % interval. obtained: the bitrate that the encoder made of it.

    largest_packet: how long a link of the bitrate asked for needs for it.
    """

    codec: Codec
    low: Accuracy | None = None
    high: Accuracy | None = None
    obtained: Bitrate | None = None
    largest_packet: PositiveSeconds | None = None


class AccuracyInContext(AccuracyAt):
    """Accuracy where a standing person is expected to be so large, the root of its box's area in pixels."""

    person_px_from: float = Field(ge=0.0)
    person_px_below: float | None = Field(default=None, gt=0.0)


class Sharing(Strict):
    """How many times as long a frame takes when so many detectors share the machine."""

    detectors: int = Field(ge=2)
    factor: float = Field(ge=1.0)


class TimeOn(Strict):
    """Execution time per frame on one machine type, worst case and mean, as it was set up there."""

    machine: str
    mean: PositiveSeconds
    maximum: PositiveSeconds | None = None
    minimum: PositiveSeconds | None = None
    p95: PositiveSeconds | None = None
    provider: str | None = None
    threads: int | None = Field(default=None, ge=1)

    @model_validator(mode="after")
    def _maximum_is_not_below_mean(self) -> TimeOn:
        if self.maximum is not None and self.maximum < self.mean:
            raise mismatch(f"{self.maximum:g} s", f"at least the mean, {self.mean:g} s", ("maximum",))
        return self


class Calibration(Strict):
    """What a score s is worth: the probability 1 / (1 + exp(-(scale log(s / (1 - s)) + offset)))."""

    scale: float = Field(gt=0.0, allow_inf_nan=False)
    offset: float = Field(allow_inf_nan=False)


class Tiles(Strict):
    """A picture in overlapping tiles. size: width and height in pixels of the picture. overlap: of neighbours,
    a share of a tile; it should hold the largest person that is looked for in tiles. whole: and one pass over
    the whole picture, for those who are larger.
    """

    size: tuple[TileSide, TileSide]
    overlap: float = Field(default=0.2, ge=0.0, le=0.9)
    whole: bool = False


class PoolDetector(Strict):
    """One detector.

    model: the ONNX file, relative to the pool file; none for a detector that is only planned with.
    card: its data sheet. score_threshold: detections below it are not reported. calibration: what a score
    above it is worth; absent: the score itself. accuracy: under the codec and by the metric that the
    provenance names; the other accuracies say more of the same. sha256: of model. layout: how it is read, a
    name or a description; absent: found out. names: of its classes, in order, where the file does not say
    them; ``coco``, ``coco91``: COCO's. classes: which of them are which layer of the map. input_size: width
    and height, for a network that leaves them free. tiles: how its pictures are cut; accuracy, times and
    memory are of all tiles of a picture together. precision: of its weights, as stated. assumed: what of this
    row was not measured, in words; repeated wherever the detector is used.
    """

    id: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    model: Path | None = None
    card: Path | None = None
    memory: Bytes
    score_threshold: Accuracy = 0.3
    calibration: Calibration | None = None
    accuracy: tuple[AccuracyAt, ...] = Field(min_length=1)
    times: tuple[TimeOn, ...] = Field(min_length=1)
    sharing: tuple[Sharing, ...] = ()
    accuracy_by_size: tuple[AccuracyOfSize, ...] = ()
    accuracy_by_codec: tuple[AccuracyWithCodec, ...] = ()
    accuracy_by_context: tuple[AccuracyInContext, ...] = ()
    layout: str | Layout | None = None
    names: tuple[str, ...] | Literal["coco", "coco91"] | None = None
    classes: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    input_size: tuple[TileSide, TileSide] | None = None
    tiles: Tiles | None = None
    precision: Literal["float32", "float16", "int8"] | None = None
    assumed: str | None = None
    sha256: str | None = Field(default=None, pattern=r"^[0-9a-f]{64}$")

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
        refuse_repeated("machine type", [row.machine for row in self.times], at="times")
        return self


class Pool(Strict):
    """The detectors, and where the numbers come from."""

    detectors: tuple[PoolDetector, ...] = Field(min_length=1)
    provenance: dict[str, Any] = Field(default_factory=dict)
    assumed: tuple[str, ...] = ()

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

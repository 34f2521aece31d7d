"""An evaluation: which detectors, on which pictures, under which codecs and bitrates, in which setups."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, model_validator

from pipeline.config.base import Strict, load, mismatch, refuse_repeated
from pipeline.config.pool import Calibration
from pipeline.config.units import Bitrate, Fraction, Hertz, PositiveSeconds
from pipeline.link.codec import Codec

Policy = Literal["refuse", "skip"]
FaultKind = Literal[
    "missing_image", "outside_box", "duplicate_id", "unknown_category", "frame_count", "not_finite"
]
Metric = Literal["ap", "ap50", "ap75", "ar1", "ar10", "ar100", "one_minus_molrp"]
_ID = r"^[A-Za-z0-9_.-]+$"


class FaultPolicy(Strict):
    """What to do about each kind of fault: refuse the evaluation, or skip what is at fault and count it.

    missing_image: an annotation names a picture that is not listed, or a listed file is not there.
    outside_box: a box reaches more than a pixel out of its picture, or has no area. duplicate_id: of pictures,
    annotations or categories. unknown_category: a box is of a category that is not listed. frame_count: a video
    has fewer or more pictures than are annotated. not_finite: a detector returns NaN or an infinite number.
    """

    missing_image: Policy = "refuse"
    outside_box: Policy = "refuse"
    duplicate_id: Policy = "refuse"
    unknown_category: Policy = "refuse"
    frame_count: Policy = "refuse"
    not_finite: Policy = "refuse"


class Sequences(Strict):
    """Image files of a COCO file as sequences, by what keys of each image say.

    by: the key whose values are the sequences, only: the values that are wanted, order: the key whose numbers
    are the order within one.
    """

    by: str
    only: tuple[int | str, ...] = Field(min_length=1)
    order: str

    @model_validator(mode="after")
    def _once(self) -> Sequences:
        refuse_repeated("sequence", self.only, at="only")
        return self


class DataSetFile(Strict):
    """One source of annotated pictures.

    format: coco: a JSON file; mission: the mission.yaml that ``searchlight simulate`` wrote; mot, visdrone: a
    folder as those data sets have it. root: what file names in COCO JSON are relative to; by default the
    JSON's folder. frame_rate: of sequences of image files; without it they cannot be transcoded.
    simulated: whether the pictures are rendered; every report says so. sequences: of a COCO file's image files
    some, as sequences.
    """

    format: Literal["coco", "mission", "mot", "visdrone"]
    path: Path
    root: Path | None = None
    frame_rate: Hertz | None = None
    simulated: bool | None = None
    sequences: Sequences | None = None

    @property
    def is_simulated(self) -> bool:
        """As stated; otherwise a mission with its truth is taken for simulated."""
        return self.format == "mission" if self.simulated is None else self.simulated

    @model_validator(mode="after")
    def _sequences_are_of_coco(self) -> DataSetFile:
        if self.sequences is not None and self.format != "coco":
            raise mismatch(f"sequences of format {self.format}", "format: coco", ("sequences",))
        return self


class Transcoding(Strict):
    """The paper's grid: one pass, fastest preset, as the missions encode.

    width, height, frame_rate: of what is encoded. keyframe_interval: at most so long between pictures that
    stand alone. keep_streams: in the output's cache, so that a detector that comes later needs no encoding;
    they take as much room as their bitrates say.
    """

    codecs: tuple[Codec, ...] = Field(min_length=1)
    bitrates: tuple[Bitrate, ...] = Field(min_length=1)
    width: int = Field(default=1024, ge=16, le=8192, multiple_of=2)
    height: int = Field(default=576, ge=16, le=8192, multiple_of=2)
    frame_rate: Hertz = 30.0
    keyframe_interval: PositiveSeconds = 2.0
    keep_streams: bool = True

    @model_validator(mode="after")
    def _once(self) -> Transcoding:
        refuse_repeated("codec", self.codecs, at="codecs")
        refuse_repeated("bitrate", self.bitrates, at="bitrates")
        return self


class EvaluatedDetector(Strict):
    """An ONNX file; id: its name in the pool. precision: as the file has it, or converted first.

    score_threshold, calibration: as chosen elsewhere, on other pictures; without a threshold both come from the
    pictures of this evaluation. scores: card, if both are those of the card that its training wrote.
    """

    id: str = Field(pattern=_ID)
    model: Path
    card: Path | None = None
    precision: Literal["as_exported", "float16", "int8"] = "as_exported"
    score_threshold: float | None = Field(default=None, gt=0.0, lt=1.0)
    calibration: Calibration | None = None
    scores: Literal["here", "card"] = "here"

    @model_validator(mode="after")
    def _the_card_is_there(self) -> EvaluatedDetector:
        if self.scores == "card" and self.card is None:
            raise mismatch("no card", "the card that the scores are from", ("card",))
        if self.scores == "card" and self.score_threshold is not None:
            raise mismatch("a threshold beside the card's", "one of both", ("score_threshold",))
        return self

    @model_validator(mode="after")
    def _calibration_has_its_threshold(self) -> EvaluatedDetector:
        if self.calibration is not None and self.score_threshold is None:
            raise mismatch(
                "calibration alone", "the score_threshold from which on it was fitted", ("calibration",)
            )
        return self


class Setup(Strict):
    """One inference setup. machine: the machine type that its times are for, as inventories name it.

    clock: wall: what a user waits. processor: what one thread works, whatever else runs meanwhile; only for
    one thread on the cpu.
    """

    machine: str = Field(pattern=_ID)
    provider: str = "cpu"
    threads: int = Field(default=1, ge=1, le=256)
    clock: Literal["wall", "processor"] = "wall"

    @model_validator(mode="after")
    def _processor_time_is_of_one_thread(self) -> Setup:
        if self.clock == "processor" and (self.threads > 1 or self.provider != "cpu"):
            raise mismatch("processor", "wall, with more than one thread or another provider", ("clock",))
        return self


class Timing(Strict):
    """pictures: timed, after warm_up that are not. sharing: numbers of detectors that share the machine."""

    setups: tuple[Setup, ...] = Field(min_length=1)
    pictures: int = Field(default=200, ge=10, le=100_000)
    warm_up: int = Field(default=10, ge=1, le=1000)
    sharing: tuple[Annotated[int, Field(ge=2, le=64)], ...] = ()

    @model_validator(mode="after")
    def _once(self) -> Timing:
        refuse_repeated("machine type", [setup.machine for setup in self.setups], at="setups")
        refuse_repeated("number of detectors", self.sharing, at="sharing")
        return self


class Bootstrap(Strict):
    """Confidence intervals. block: long sequences are cut into pieces of this length, drawn one by one."""

    replicates: int = Field(default=200, ge=20, le=10_000)
    seed: int = Field(default=1, ge=0)
    block: PositiveSeconds | None = None


class PoolPart(Strict):
    """What the pool says: the metric and the codec that allocation goes by."""

    metric: Metric = "ap50"
    codec: Codec = "h264"


class Evaluation(Strict):
    """Everything that ``searchlight evaluate`` reads. Paths are relative to the file.

    categories: names in the data sets that count as a person; others are left out. visible_min: people less
    visible are ignore regions, where the data set knows. sample_rate: of the pictures that are looked at.
    score_cutoff: detections below it are not kept; the paper's networks have 0.3. Accuracy is measured once,
    on one thread of the first setup's provider: more threads change times alone.
    """

    name: str = Field(pattern=_ID)
    datasets: tuple[DataSetFile, ...] = Field(min_length=1)
    detectors: tuple[EvaluatedDetector, ...] = Field(min_length=1)
    categories: tuple[str, ...] = Field(default=("person",), min_length=1)
    visible_min: Fraction = 0.3
    sample_rate: Hertz = 2.0
    score_cutoff: float = Field(default=0.05, gt=0.0, lt=1.0)
    transcoding: Transcoding | None = None
    timing: Timing | None = None
    bootstrap: Bootstrap = Bootstrap()
    faults: FaultPolicy = FaultPolicy()
    pool: PoolPart = PoolPart()

    @model_validator(mode="after")
    def _names_are_unique(self) -> Evaluation:
        refuse_repeated("detector", [detector.id for detector in self.detectors], at="detectors")
        refuse_repeated("data set", [(d.path, d.root) for d in self.datasets], at="datasets")
        return self

    @model_validator(mode="after")
    def _pool_codec_is_measured(self) -> Evaluation:
        if self.transcoding is not None and self.pool.codec not in self.transcoding.codecs:
            expected = "one of transcoding.codecs: " + ", ".join(self.transcoding.codecs)
            raise mismatch(self.pool.codec, expected, ("pool", "codec"))
        return self


def load_evaluation(path: Path) -> Evaluation:
    """Read and validate an evaluation file; all paths come back resolved against it."""
    evaluation = load(path, Evaluation)
    base = path.parent
    datasets = tuple(
        d.model_copy(update={"path": base / d.path, "root": None if d.root is None else base / d.root})
        for d in evaluation.datasets
    )
    detectors = tuple(
        _with_scores(
            d.model_copy(update={"model": base / d.model, "card": None if d.card is None else base / d.card})
        )
        for d in evaluation.detectors
    )
    return evaluation.model_copy(update={"datasets": datasets, "detectors": detectors})


def _with_scores(detector: EvaluatedDetector) -> EvaluatedDetector:
    """With the card's threshold and calibration, where it goes by them."""
    if detector.scores == "here" or detector.card is None:
        return detector
    scores = load(detector.card, _Card).scores
    return detector.model_copy(
        update={"score_threshold": scores.threshold, "calibration": scores.calibration}
    )


class _CardScores(Strict):
    # a card says much more
    model_config = ConfigDict(extra="ignore")

    threshold: float = Field(gt=0.0, lt=1.0)
    calibration: Calibration | None


class _Card(Strict):
    """What is read of a detector's card."""

    model_config = ConfigDict(extra="ignore")

    scores: _CardScores

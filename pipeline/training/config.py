"""What a detector is trained from: ``configs/detectors/*.train.yaml``."""

from __future__ import annotations

from pathlib import Path
from typing import Self

from pydantic import Field, model_validator

from pipeline.config.base import Strict, load, mismatch
from pipeline.training.augmentation import AugmentationParams
from pipeline.training.network_params import NetworkParams

_NAME = r"^[A-Za-z0-9_.-]+$"


class Input(Strict):
    """What the network sees: a whole picture at this size, pixels."""

    width: int = Field(ge=64, multiple_of=16)
    height: int = Field(ge=64, multiple_of=16)


class Scenes(Strict):
    """So many pictures, spread evenly over the scenes seed, seed + 1, .."""

    seed: int
    scenes: int = Field(ge=1)
    pictures: int = Field(ge=1)


class Data(Strict):
    """Simulated pictures: train is learned from, the others are not.

    mission: as a mission sees people. sizes: from nearer and further, people of every size.
    """

    train: Scenes
    mission: Scenes
    sizes: Scenes


class LabelledPictures(Strict):
    """Real pictures of one size with COCO labels, split by what a key of each image says.

    labels: relative to the training file. folder: that file names are relative to; by default the labels'.
    categories: names of what is a person. split_by: neighbouring pictures are almost the same, so that whole
    flights (or places) are learned from (train) or only measured on (test). Threshold and calibration come from
    calibration, which is not learned from, or, where no group can be spared, from folds: parts of train; for
    each of them a further network learns from the rest, by the same recipe, and looks at what it has not seen.
    by: keys of the images that the card splits the accuracy by, with edges for numbers. sizes: edges of the
    classes by the square root of a person's area, pixels.
    """

    labels: Path
    folder: Path | None = None
    categories: tuple[str, ...] = Field(default=("person",), min_length=1)
    split_by: str
    train: tuple[int | str, ...] = Field(min_length=1)
    calibration: tuple[int | str, ...] = ()
    folds: tuple[tuple[int | str, ...], ...] = ()
    test: tuple[int | str, ...] = Field(min_length=1)
    by: dict[str, tuple[float, ...]] = Field(default_factory=dict)
    sizes: tuple[float, ...] = ()
    attribution: str = Field(min_length=1)

    @property
    def groups(self) -> tuple[int | str, ...]:
        """Of all parts."""
        return self.train + self.calibration + self.test

    @model_validator(mode="after")
    def _parts_are_apart(self) -> Self:
        seen: dict[int | str, str] = {}
        for part in ("train", "calibration", "test"):
            for group in getattr(self, part):
                if group in seen:
                    raise mismatch(
                        f"{self.split_by} {group}, which is in {seen[group]} too",
                        "a part of its own",
                        (part,),
                    )
                seen[group] = part
        return self

    @model_validator(mode="after")
    def _scores_come_from_somewhere(self) -> Self:
        if bool(self.calibration) == bool(self.folds):
            found = "both" if self.folds else "neither calibration nor folds"
            raise mismatch(found, "calibration (not learned from) or folds (of train)", ("calibration",))
        left_out = [group for fold in self.folds for group in fold]
        for i, fold in enumerate(self.folds):
            if not fold or set(fold) >= set(self.train):
                raise mismatch(f"{list(fold)}", f"some of train, {list(self.train)}, not all", ("folds", i))
        for group in left_out:
            if group not in self.train or left_out.count(group) > 1:
                raise mismatch(f"{self.split_by} {group}", "groups of train, each in one fold", ("folds",))
        return self


class Optimisation(Strict):
    """AdamW with a warm-up and cosines; the mean of the weights (EMA) is what is exported.

    cycles: the steps are split into so many cosines, each from half the rate of the one before (SGDR,
    arXiv:1608.03983); the network is at its best at the end of each.
    save_every: steps between checkpoints. half_precision: the features are computed in bfloat16, which takes
    half the time on a processor that has it (AVX512-BF16, AMX).
    """

    seed: int
    steps: int = Field(ge=1)
    cycles: int = Field(ge=1)
    batch: int = Field(ge=1)
    learning_rate: float = Field(gt=0.0)
    weight_decay: float = Field(ge=0.0)
    warmup_steps: int = Field(ge=0)
    ema_decay: float = Field(ge=0.0, lt=1.0)
    save_every: int = Field(ge=1)
    threads: int = Field(ge=1)
    half_precision: bool


class Training(Strict):
    """One training. start: another training, finished in the same folder, whose weights it begins with.

    data or labelled: simulated pictures, or real ones. purpose: for the card of a detector of real pictures.
    """

    name: str = Field(pattern=_NAME)
    start: str | None = Field(default=None, pattern=_NAME)
    purpose: str | None = None
    input: Input
    network: NetworkParams
    data: Data | None = None
    labelled: LabelledPictures | None = None
    augmentation: AugmentationParams
    optimisation: Optimisation

    @property
    def trained_on(self) -> str:
        """For the ONNX file, with the attribution that real pictures ask for."""
        return "simulated scenes" if self.labelled is None else f"real pictures: {self.labelled.attribution}"

    @model_validator(mode="after")
    def _has_pictures(self) -> Self:
        if (self.data is None) == (self.labelled is None):
            found = "neither data nor labelled" if self.data is None else "data and labelled"
            raise mismatch(found, "data (simulated pictures) or labelled (real ones)")
        if self.labelled is not None and self.purpose is None:
            raise mismatch("no purpose", "what the detector is for, said on its card", ("purpose",))
        return self


def load_training(path: Path) -> Training:
    """Read and validate a training file."""
    return load(path, Training)

"""What a detector is trained from: ``configs/detectors/*.train.yaml``."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from pipeline.config.base import Strict, load
from pipeline.training.augmentation import AugmentationParams
from pipeline.training.network import NetworkParams

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
    """One training. start: another training, finished in the same folder, whose weights it begins with."""

    name: str = Field(pattern=_NAME)
    start: str | None = Field(default=None, pattern=_NAME)
    input: Input
    network: NetworkParams
    data: Data
    augmentation: AugmentationParams
    optimisation: Optimisation


def load_training(path: Path) -> Training:
    """Read and validate a training file."""
    return load(path, Training)

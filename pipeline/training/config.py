"""What a detector is trained from: ``configs/detectors/*.train.yaml``."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from pipeline.config.base import Strict, load
from pipeline.training.augmentation import AugmentationParams
from pipeline.training.network import NetworkParams


class Input(Strict):
    """What the network sees: a whole picture at this size, pixels."""

    width: int = Field(ge=64, multiple_of=16)
    height: int = Field(ge=64, multiple_of=16)


class Data(Strict):
    """Simulated pictures. Scenes train_seed, train_seed + 1, .. are learned from, held_out_seed, .. not."""

    train_seed: int
    train_scenes: int = Field(ge=1)
    train_pictures: int = Field(ge=1)
    held_out_seed: int
    held_out_scenes: int = Field(ge=1)
    held_out_pictures: int = Field(ge=1)


class Optimisation(Strict):
    """AdamW with a warm-up and cosines; the mean of the weights (EMA) is what is exported.

    cycles: the steps are split into so many cosines, each from half the rate of the one before (SGDR,
    arXiv:1608.03983); the network is at its best at the end of each.
    save_every: steps between checkpoints.
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


class Training(Strict):
    """One training."""

    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    input: Input
    network: NetworkParams
    data: Data
    augmentation: AugmentationParams
    optimisation: Optimisation


def load_training(path: Path) -> Training:
    """Read and validate a training file."""
    return load(path, Training)

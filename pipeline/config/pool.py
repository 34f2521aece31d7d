"""The pool: every detector that may be used, how accurate it is at which bitrate, how long it takes where."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from pipeline.config.base import Strict, load, mismatch, refuse_repeated
from pipeline.config.units import Bitrate, Bytes, PositiveSeconds

Accuracy = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]


class AccuracyAt(Strict):
    """Accuracy (AP .5 unless the provenance says otherwise) on video of this bitrate."""

    bitrate: Bitrate
    accuracy: Accuracy


class TimeOn(Strict):
    """Execution time per frame on one machine type, worst case and mean."""

    machine: str
    mean: PositiveSeconds
    maximum: PositiveSeconds | None = None

    @model_validator(mode="after")
    def _maximum_is_not_below_mean(self) -> TimeOn:
        if self.maximum is not None and self.maximum < self.mean:
            raise mismatch(f"{self.maximum:g} s", f"at least the mean, {self.mean:g} s", ("maximum",))
        return self


class PoolDetector(Strict):
    """One detector.

    model: the ONNX file, relative to the pool file; none for a detector that is only planned with.
    card: its data sheet. score_threshold: detections below it are not reported.
    """

    id: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    model: Path | None = None
    card: Path | None = None
    memory: Bytes
    score_threshold: Accuracy = 0.3
    accuracy: tuple[AccuracyAt, ...] = Field(min_length=1)
    times: tuple[TimeOn, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _rows_are_unique(self) -> PoolDetector:
        refuse_repeated("bitrate", [row.bitrate for row in self.accuracy], at="accuracy")
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

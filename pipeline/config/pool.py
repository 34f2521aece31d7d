"""The pool: every detector that may be used, how accurate it is at which bitrate, how long it takes where."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from pipeline.config.base import Strict, load
from pipeline.config.units import BitsPerSecond, Bytes, PositiveSeconds

Accuracy = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]


class AccuracyAt(Strict):
    """Accuracy (AP .5 unless the provenance says otherwise) on video of this bitrate."""

    bitrate: BitsPerSecond
    accuracy: Accuracy


class TimeOn(Strict):
    """Execution time per frame on one machine type, worst case and mean."""

    machine: str
    mean: PositiveSeconds
    maximum: PositiveSeconds | None = None


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


class Pool(Strict):
    """The detectors, and where the numbers come from."""

    detectors: tuple[PoolDetector, ...] = Field(min_length=1)
    provenance: dict[str, Any] = {}
    assumed: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _names_are_unique(self) -> Pool:
        names = [detector.id for detector in self.detectors]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"detector {name!r} once, not {names.count(name)} times")
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

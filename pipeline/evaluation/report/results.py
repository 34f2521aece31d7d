"""Everything that an evaluation found, in one file that pool, tables and report are made of."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from pipeline.config.evaluation import Metric
from pipeline.config.pool import Calibration
from pipeline.errors import InputError
from pipeline.evaluation.measuring.operating_points import MeasuredOperatingPoint
from pipeline.evaluation.measuring.setup_timing import SetupTiming
from pipeline.evaluation.metrics.cell import Cell
from pipeline.link.codec import Codec


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class DetectorFile(_Record):
    """A detector as it was evaluated.

    score_threshold: where LRP over all conditions together is least. calibration: of the scores above it;
    calibration_error: their expected calibration error, and after calibration, if there is one. operating_points:
    what its boxes are worth under each condition. scores_given: threshold and calibration are the evaluation
    file's, chosen on other pictures.
    """

    id: str
    model: str
    card: str | None
    sha256: str
    precision: str
    score_threshold: float
    calibration: Calibration | None = None
    calibration_error: float | None = None
    calibrated_error: float | None = None
    operating_points: tuple[MeasuredOperatingPoint, ...] = ()
    scores_given: bool = False


class Provenance(_Record):
    """Where and when, with what, on what. seconds: that all cells took, over all processes, by what
    they were spent on; seconds_this_run: those that were worked now.

    size_mix: share of people small, medium and large, at the size in which pictures are looked at.
    """

    evaluation: str
    evaluation_sha256: str
    dataset_sha256: str
    sequences: tuple[str, ...]
    pictures: int
    people: int
    ignored: int
    size_mix: dict[str, float]
    simulated: bool
    machine: str
    cores: int
    versions: dict[str, str]
    date: str
    faults: tuple[str, ...]
    missing_codecs: tuple[str, ...]
    seconds: dict[str, float]
    seconds_this_run: dict[str, float]


class Results(_Record):
    """metric, codec: what the pool goes by."""

    format: Literal["searchlight evaluation"] = "searchlight evaluation"
    version: Literal[1] = 1
    name: str
    metric: Metric
    codec: Codec
    score_cutoff: float
    detectors: tuple[DetectorFile, ...]
    cells: tuple[Cell, ...]
    timings: tuple[SetupTiming, ...]
    provenance: Provenance

    def cell(self, detector: str, codec: Codec | None, bitrate_bps: float | None) -> Cell | None:
        """One cell, None if it was not measured."""
        for cell in self.cells:
            if (cell.detector, cell.codec, cell.bitrate_bps) == (detector, codec, bitrate_bps):
                return cell
        return None

    @property
    def codecs(self) -> tuple[Codec, ...]:
        """Those measured, in the order of the grid."""
        return tuple(dict.fromkeys(cell.codec for cell in self.cells if cell.codec is not None))

    @property
    def bitrates_bps(self) -> tuple[float, ...]:
        """Those measured, rising."""
        return tuple(sorted({cell.bitrate_bps for cell in self.cells if cell.bitrate_bps is not None}))


def load_results(path: Path) -> Results:
    """Read results.json. Raises InputError if it is not one."""
    try:
        return Results.model_validate_json(path.read_bytes())
    except OSError as error:
        raise InputError(
            path, f"no readable file ({error.strerror})", "the results of an evaluation"
        ) from None
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        where = f"{path} {'.'.join(map(str, fault['loc']))}"
        raise InputError(where, str(fault["msg"]), "the results of an evaluation") from None

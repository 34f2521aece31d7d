"""An allocation problem on its own: streams without videos, for planning before a mission."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, model_validator

from pipeline.config.base import Strict, load, mismatch, refuse_repeated
from pipeline.config.processing import Processing
from pipeline.config.units import PositiveMeters, Radians


class View(Strict):
    """How a stream looks at the ground: height above it, pitch (negative is down), focal length in pixels."""

    height: PositiveMeters
    pitch: Radians
    focal_px: float = Field(gt=0.0, le=1e6)


class PlannedStream(Strict):
    """A stream. site: where it is filmed. count: so many equal ones, named ID, ID-2, ID-3, ..; the
    inventory's links of ID are those of each. view: needed for processing.expected_size. priority: the
    greater the more it matters, when it is planned again and not all streams can be served.
    """

    id: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    site: str
    count: int = Field(default=1, ge=1, le=10_000)
    view: View | None = None
    priority: int = Field(default=0, ge=-1000, le=1000)

    @property
    def names(self) -> tuple[str, ...]:
        """ID, ID-2, ID-3, .. up to the count."""
        return self.id, *(f"{self.id}-{number}" for number in range(2, self.count + 1))


class AllocationProblem(Strict):
    """Everything that an allocation reads. Paths are relative to the file."""

    streams: tuple[PlannedStream, ...] = Field(min_length=1)
    inventory: Path
    pool: Path
    processing: Processing

    @model_validator(mode="after")
    def _streams_are_unique(self) -> AllocationProblem:
        names: set[str] = set()
        for number, stream in enumerate(self.streams):
            if again := names.intersection(stream.names):
                raise mismatch(f"stream {min(again)!r} again", "every stream once", ("streams", number, "id"))
            names.update(stream.names)
        refuse_repeated("codec", list(self.processing.codecs), at="processing")
        if self.processing.expected_size:
            for number, stream in enumerate(self.streams):
                if stream.view is None:
                    at = ("streams", number, "view")
                    raise mismatch("none", "a view, since processing.expected_size is on", at)
        return self


def load_problem(path: Path) -> AllocationProblem:
    """Read and validate a problem file; the paths come back resolved against it."""
    problem = load(path, AllocationProblem)
    base = path.parent
    return problem.model_copy(update={"inventory": base / problem.inventory, "pool": base / problem.pool})

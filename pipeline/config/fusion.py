"""The sensor model, the map, and what is mapped."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from pipeline.config.base import Strict, mismatch
from pipeline.config.second_look import SecondLook
from pipeline.config.uncertainty import Uncertainty
from pipeline.config.units import Fraction, PositiveMeters, PositiveSeconds

HalfFraction = Annotated[float, Field(ge=0.0, le=0.5, allow_inf_nan=False)]
SignificantPoint = Literal["bottom_center", "center"]
#: width and height of a standing person, metres
PERSON_WIDTH_M, PERSON_HEIGHT_M = 0.5, 1.7


class ObjectSize(Strict):
    """Least and greatest extent of an object of the class, as it can appear in a picture."""

    width_min: PositiveMeters
    """Least width, less than `width_max`. Example: `{meters: 0.2}`."""
    width_max: PositiveMeters
    """Greatest width. Example: `{meters: 2.2}`."""
    height_min: PositiveMeters
    """Least height, less than `height_max`. Example: `{meters: 0.2}`."""
    height_max: PositiveMeters
    """Greatest height. Example: `{meters: 2.2}`."""

    @model_validator(mode="after")
    def _ordered(self) -> ObjectSize:
        if self.width_min >= self.width_max:
            raise mismatch(
                f"{self.width_min:g} m", f"less than width_max, {self.width_max:g} m", ("width_min",)
            )
        if self.height_min >= self.height_max:
            raise mismatch(
                f"{self.height_min:g} m", f"less than height_max, {self.height_max:g} m", ("height_min",)
            )
        return self


class ObjectClass(Strict):
    """What a class of objects looks like."""

    id: int = Field(ge=0)
    """The detectors' class number. Example: `2`."""
    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    """Of its layer of the map; letters, digits, `_`, `.`, `-`. Example: `car`."""
    significant_point: SignificantPoint
    """The point of a box that stands for the place."""
    object_size: ObjectSize
    """Boxes of other sizes count less, or not at all."""
    typical_width: PositiveMeters | None = None
    """Of an object that was missed, for the probability of detection. Absent: the middle between the least and
    the greatest. Example: `{meters: 1.8}`.
    """
    typical_height: PositiveMeters | None = None
    """The same of its height. Example: `{meters: 1.5}`."""


#: boxes of people, standing or lying, near or half hidden
_PERSON_SIZE = ObjectSize.model_construct(width_min=0.2, width_max=2.2, height_min=0.2, height_max=2.2)
#: the height that the default cell size is for, metres
_USUAL_HEIGHT_M = 50.0
_LEAST_CELL_M, _MOST_CELL_M, _CELL_STEP_M = 0.5, 2.0, 0.25
#: people who are nearer to each other are one place by default, metres
_APART_M = 2.0


def default_cell_m(uncertainty: Uncertainty) -> float:
    """Twice what a look from 50 m is off by its noise, in steps of 0.25 m, at least 0.5 m and at most 2 m.

    Finer cells cost time and tell nothing more; in coarser ones neighbours become one.
    """
    noise_m = math.hypot(uncertainty.position_noise, _USUAL_HEIGHT_M * uncertainty.attitude_noise)
    cell_m = math.ceil(round(2.0 * noise_m / _CELL_STEP_M, 6)) * _CELL_STEP_M
    return min(max(cell_m, _LEAST_CELL_M), _MOST_CELL_M)


def default_cluster_m(cell_m: float) -> float:
    """Two metres, or two cells if that is more: cells that touch are one place anyway."""
    return max(_APART_M, 2.0 * cell_m)


class Fusion(Strict):
    """The sensor model and the salient locations (the paper's section 'Detection fusion').

    A mission needs none of it.
    """

    cell_size: PositiveMeters = math.nan
    """Side of the map's cells. Absent: twice what a look from 50 m is off by its noise (`uncertainty`), from 0.5 m
    to 2 m. Example: `{meters: 0.5}`.
    """
    positive_max: HalfFraction = 0.36
    """How much a sure detection raises a probability above 0.5."""
    negative_max: HalfFraction = 0.2
    """How much a look that found nothing lowers a probability below 0.5, at most."""
    tukey_alpha: Fraction = 0.5
    """Share of the range of box sizes over which detections count less towards its ends."""
    significant_point: SignificantPoint = "bottom_center"
    """The point of a box of a person that stands for the place."""
    object_size: ObjectSize = _PERSON_SIZE
    """Of persons, the detectors' class 0."""
    further_classes: tuple[ObjectClass, ...] = ()
    """What else is mapped, each class in a layer of its own."""
    threshold: Fraction = 0.7
    """Places above this probability are reported; more than 0.5, less than `clamp_max`."""
    cluster_distance: PositiveMeters = math.nan
    """Cells above the threshold that are closer than that are one place. Absent: 2 m, or two cells if that is more.
    Example: `{meters: 2}`.
    """
    possible_frames: int = Field(default=3, ge=2)
    """A place below the threshold that was detected in so many frames is listed apart, as possible."""
    update_rule: Literal["with_uncertainty", "paper"] = "with_uncertainty"
    """``paper``: the map is updated as if every pose were exact and every frame a look of its own; the error
    ellipses of places follow `uncertainty` under both.
    """
    clamp_min: float = Field(default=0.1192, ge=0.0, lt=0.5)
    """Least probability of a cell."""
    clamp_max: float = Field(default=0.971, gt=0.5, le=1.0)
    """Greatest probability of a cell."""
    lateness: PositiveSeconds = 2.0
    """With `--pace realtime`: how long a result is waited for before later ones are applied."""
    replay: PositiveSeconds = 120.0
    """With `--pace realtime`: a result that comes later than `lateness` is put in its place all the same, up to so long
    after the newest; later ones are applied when they come, and counted.
    """
    replay_results: int = Field(default=20_000, ge=1)
    """So many of the last results are kept for `replay` at most, about 2 KB each; where more come, it is shorter."""
    uncertainty: Uncertainty = Uncertainty()
    """Of what places are computed from."""
    second_look: SecondLook = SecondLook()
    """What is worth a second look."""

    @model_validator(mode="after")
    def _cells_follow_from_the_errors(self) -> Fusion:
        if math.isnan(self.cell_size):
            object.__setattr__(self, "cell_size", default_cell_m(self.uncertainty))
        if math.isnan(self.cluster_distance):
            object.__setattr__(self, "cluster_distance", default_cluster_m(self.cell_size))
        return self

    @model_validator(mode="after")
    def _threshold_can_be_reached(self) -> Fusion:
        if not 0.5 < self.threshold < self.clamp_max:
            expected = f"more than 0.5 and less than clamp_max, {self.clamp_max:g}"
            raise mismatch(f"{self.threshold:g}", expected, ("threshold",))
        return self

    @model_validator(mode="after")
    def _classes_are_unique(self) -> Fusion:
        for number, added in enumerate(self.further_classes):
            for kind in ("id", "name"):
                if getattr(added, kind) in [getattr(c, kind) for c in self.classes[: number + 1]]:
                    at = ("further_classes", number, kind)
                    raise mismatch(f"{getattr(added, kind)!r} again", f"every {kind} once, persons' too", at)
        return self

    @property
    def classes(self) -> tuple[ObjectClass, ...]:
        """Persons first, then the further classes."""
        person = ObjectClass.model_construct(
            id=0,
            name="person",
            significant_point=self.significant_point,
            object_size=self.object_size,
            typical_width=PERSON_WIDTH_M,
            typical_height=PERSON_HEIGHT_M,
        )
        return (person, *self.further_classes)

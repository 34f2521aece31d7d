"""The sensor model, the map, and what is mapped."""

from __future__ import annotations

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
    """Least and greatest extent of an object of the class, metres, as it can appear in a picture."""

    width_min: PositiveMeters
    width_max: PositiveMeters
    height_min: PositiveMeters
    height_max: PositiveMeters

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
    """What a class of objects looks like. id: the detectors' class id. name: of its layer of the map.

    typical_width, typical_height: of an object that was missed, for the probability of detection; absent: the
    middle between the least and the greatest.
    """

    id: int = Field(ge=0)
    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    significant_point: SignificantPoint
    object_size: ObjectSize
    typical_width: PositiveMeters | None = None
    typical_height: PositiveMeters | None = None


class Fusion(Strict):
    """The sensor model and the salient locations (the paper's section 'Detection fusion').

    significant_point, object_size: of persons, the detectors' class 0. further_classes: what else is mapped,
    each class in a layer of its own.
    """

    cell_size: PositiveMeters
    positive_max: HalfFraction
    negative_max: HalfFraction
    tukey_alpha: Fraction
    significant_point: SignificantPoint
    object_size: ObjectSize
    further_classes: tuple[ObjectClass, ...] = ()
    threshold: Fraction
    cluster_distance: PositiveMeters
    clamp_min: float = Field(default=0.1192, ge=0.0, lt=0.5)
    clamp_max: float = Field(default=0.971, gt=0.5, le=1.0)
    lateness: PositiveSeconds
    uncertainty: Uncertainty = Uncertainty()
    second_look: SecondLook = SecondLook()

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

"""Whether two places may be two sights of one person.

They may be, if their positions agree within their errors and no frames show both. Errors that all looks of a stream
share move the places of one stream together: of two places that the same streams saw they are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from pipeline.config.uncertainty import Uncertainty
from pipeline.fusion.error_ellipse import PROBABILITY, chi_square_2
from pipeline.fusion.error_propagation import place_covariance
from pipeline.fusion.salient import SalientLocation
from pipeline.fusion.sightings import seen_at_once
from pipeline.messages import FloatArray


def with_may_be(places: Sequence[SalientLocation], uncertainty: Uncertainty) -> tuple[SalientLocation, ...]:
    """The places, each with the ids of those of its class that may be the same person."""
    same: dict[int, list[int]] = {place.id: [] for place in places}
    for a, b in combinations(places, 2):
        if may_be_one(a, b, uncertainty):
            same[a.id].append(b.id)
            same[b.id].append(a.id)
    return tuple(replace(place, may_be=tuple(same[place.id])) for place in places)


def may_be_one(a: SalientLocation, b: SalientLocation, uncertainty: Uncertainty) -> bool:
    """Whether the places a and b may be one person, at 95 % of the difference of their positions."""
    apart = (a.position_enu - b.position_enu)[:2]
    # what costs little comes first, and rules out nearly all pairs
    if a.class_name != b.class_name or not _agree(apart, a.error.covariance_m2 + b.error.covariance_m2):
        return False
    if seen_at_once(a.sightings, b.sightings):
        return False
    if a.streams != b.streams:
        return True
    noise = uncertainty.model_copy(update={"position_bias": 0.0, "height_bias": 0.0, "attitude_bias": 0.0})
    return _agree(apart, _covariance(a, noise) + _covariance(b, noise))


def _agree(apart: FloatArray, covariance_m2: FloatArray) -> bool:
    return bool(apart @ np.linalg.solve(covariance_m2, apart) <= chi_square_2(PROBABILITY))


def _covariance(place: SalientLocation, uncertainty: Uncertainty) -> FloatArray:
    if not place.sightings:
        return place.error.covariance_m2
    return place_covariance(place.sightings, uncertainty)


def expected_people(places: Sequence[SalientLocation]) -> float:
    """How many people are to be expected at all places together; of those that may be one person the surest counts."""
    by_id, total, counted = {place.id: place for place in places}, 0.0, set[int]()
    for place in places:
        if place.id in counted:
            continue
        group, left = {place.id}, [place.id]
        while left:
            more = [k for k in by_id[left.pop()].may_be if k in by_id and k not in group]
            group.update(more)
            left += more
        counted |= group
        total += max(by_id[k].expected_people for k in group)
    return total

"""Two streams that place the same people apart by more than the errors that the mission states.

Errors that all looks of a stream share (the offset of its satellite position, of its compass) move all that it sees
together. So two streams whose errors are larger than stated see several people twice, each time apart by about the
same; and two people who really are apart are so for both streams. What a place shows of each stream is compared, and
of places that one of the two alone saw, those that are nearest to each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from pipeline.config.uncertainty import Uncertainty
from pipeline.fusion.error_propagation import place_covariance
from pipeline.fusion.localization import locate
from pipeline.fusion.look import Look
from pipeline.fusion.salient import SalientLocation
from pipeline.messages import FloatArray

#: farther apart are other people
_FARTHEST_M = 20.0
#: chi-square of two numbers: one of a hundred pairs with true errors is beyond, and one of twenty
_BEYOND, _USUAL = 9.21, 5.99
#: one alone may be two people
_LEAST_PAIRS = 2


@dataclass(frozen=True, slots=True)
class Disagreement:
    """apart_m: how far the second stream's places lie east and north of the first's, the median of the pairs.

    stated_m: what that may be by the stated errors, one standard deviation of its direction. pairs: that show it.
    """

    streams: tuple[str, str]
    apart_m: tuple[float, float]
    stated_m: float
    pairs: int


@dataclass(frozen=True, eq=False)
class _Sight:
    """What one stream shows at one place: its middle (2,) and sightings."""

    at: FloatArray
    looks: Sequence[Look]


def disagreements(places: Sequence[SalientLocation], uncertainty: Uncertainty) -> tuple[Disagreement, ...]:
    """Of every two streams that saw at least two people both, and do not agree where."""
    sights = [_by_stream(place) for place in places]
    names = sorted({name for sight in sights for name in sight})
    found = (_between(a, b, sights, uncertainty) for a, b in combinations(names, 2))
    return tuple(one for one in found if one is not None)


def _by_stream(place: SalientLocation) -> dict[str, _Sight]:
    names = {look.stream for look in place.sightings}
    looks = {name: [k for k in place.sightings if k.stream == name] for name in names}
    return {name: _Sight(locate(mine), mine) for name, mine in looks.items()}


def _between(
    a: str, b: str, sights: Sequence[dict[str, _Sight]], uncertainty: Uncertainty
) -> Disagreement | None:
    pairs = [(s[a], s[b]) for s in sights if a in s and b in s]
    pairs += _nearest(
        [s[a] for s in sights if a in s and b not in s], [s[b] for s in sights if b in s and a not in s]
    )
    if len(pairs) < _LEAST_PAIRS:
        return None
    apart = np.array([q.at - p.at for p, q in pairs])
    middle = np.median(apart, axis=0)
    # an angle moves places by what depends on where they are seen from; a position moves all alike
    angles = uncertainty.model_copy(update={"position_bias": 0.0, "height_bias": 0.0})
    alike = [
        _distance2(d - middle, _covariance(*pair, angles)) <= _USUAL
        for d, pair in zip(apart, pairs, strict=True)
    ]
    if sum(alike) < max(_LEAST_PAIRS, len(pairs) / 2.0):
        return None
    stated = [_covariance(*pair, uncertainty) for pair, same in zip(pairs, alike, strict=True) if same]
    far = [_distance2(middle, covariance) for covariance in stated]
    if float(np.median(far)) <= _BEYOND:
        return None
    length = float(np.hypot(*middle))
    return Disagreement(
        (a, b), (float(middle[0]), float(middle[1])), length / float(np.sqrt(np.median(far))), len(far)
    )


def _nearest(first: Sequence[_Sight], second: Sequence[_Sight]) -> list[tuple[_Sight, _Sight]]:
    """Those that are each other's nearest."""
    if not first or not second:
        return []
    a, b = np.array([p.at for p in first]), np.array([q.at for q in second])
    distance = np.linalg.norm(a[:, None] - b[None], axis=2)
    to_b, to_a = distance.argmin(axis=1), distance.argmin(axis=0)
    return [
        (first[i], second[j])
        for i, j in enumerate(to_b.tolist())
        if to_a[j] == i and distance[i, j] <= _FARTHEST_M
    ]


def _covariance(p: _Sight, q: _Sight, uncertainty: Uncertainty) -> FloatArray:
    """Of the difference: the streams' own errors; the ground and the body are the same for both, but that is little."""
    return np.asarray(place_covariance(p.looks, uncertainty) + place_covariance(q.looks, uncertainty))


def _distance2(apart: FloatArray, covariance: FloatArray) -> float:
    return float(apart @ np.linalg.solve(covariance, apart))

"""How sure the published list is that somebody is at a place.

The map's cells are the state of a filter: clamped, raised and lowered by sums that take frames for looks. A place is
published with another number, the probability that its boxes are right.

A detector's calibrated score says how often such a box is right. Twenty boxes of one thing are not twenty witnesses:
what makes a rock look like a person does so in every frame, and what hides a person hides it from many. So scores of
one thing are averaged (in log-odds, which is the posterior if all share one cause), not multiplied, and frames that
missed it do not speak against what was detected: a person under a bush is detected in one frame of ten, and is there.
Whoever walked away is no longer there: a place is of the time when it was last seen.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.fusion.look import Look

#: scores are taken to be this far from 0 and 1: no detector was measured to be surer
_CERTAINTY = 0.01


def published_probability(sightings: Sequence[Look]) -> float:
    """Of at least one sighting: the mean of its scores in log-odds, as a probability in 0.01..0.99.

    A score counts for as much as it holds at the bitrate (``Look.trust``): at 50 kbps a network finds people in blocks
    of noise, and is as sure of them.
    """
    scores = np.clip([look.score * look.trust for look in sightings], _CERTAINTY, 1.0 - _CERTAINTY)
    mean = float(np.log(scores / (1.0 - scores)).mean())
    return float(1.0 / (1.0 + np.exp(-mean)))

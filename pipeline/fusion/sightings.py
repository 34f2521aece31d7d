"""What a set of sightings says together: how many looks they are, and how many people they show at once.

A *sighting* is one box that raised the map (the record ``Look``). A *look* is one stream's unbroken view: sightings of
one stream that follow one another within LOOK_GAP_NS. Two streams that see a place at once are two looks.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

from pipeline.fusion.look import Look
from pipeline.fusion.voxel_map import LOOK_GAP_NS

#: so many frames, and this share of those that show anybody, must show several people at once to be believed: a
#: network now and then draws two boxes around one person
_FRAMES_AT_ONCE, _SHARE_AT_ONCE = 2, 0.1


def count_looks(sightings: Sequence[Look]) -> int:
    """In how many looks the sightings were made."""
    looks = 0
    for stream in {s.stream for s in sightings}:
        times = sorted(s.time_ns for s in sightings if s.stream == stream)
        looks += 1 + sum(b - a > LOOK_GAP_NS for a, b in pairwise(times))
    return looks


def count_frames(sightings: Sequence[Look]) -> int:
    """In how many frames they were made; detectors that look at the same frame count once."""
    return len({(s.stream, s.time_ns) for s in sightings})


def people_at_once(sightings: Sequence[Look]) -> int:
    """The most people that the sightings show at once, at least 1, duplicates of boxes left aside."""
    boxes = Counter((s.stream, s.detector, s.time_ns) for s in sightings)
    enough = max(_FRAMES_AT_ONCE, _SHARE_AT_ONCE * len(boxes))
    counts = sorted(boxes.values(), reverse=True)
    return next((n for n in counts if sum(c >= n for c in counts) >= enough), 1)


def seen_at_once(some: Sequence[Look], others: Sequence[Look]) -> bool:
    """Whether enough frames show both, so that they cannot be one person."""
    mine, theirs = ({(s.stream, s.detector, s.time_ns) for s in side} for side in (some, others))
    return len(mine & theirs) >= max(_FRAMES_AT_ONCE, _SHARE_AT_ONCE * min(len(mine), len(theirs)))

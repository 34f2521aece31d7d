"""When a cell is looked at anew: the compiled accounts of looks, of as many as two viewpoints at a time.

A look is one viewpoint's unbroken view of a cell: frames that follow one another within a pause. What hides a person
from one of them hides the person from the next, so a look is as good as its best frame; another viewpoint at the same
time is another look. A cell keeps the looks of two viewpoints open, that of its newest frame (``viewpoint``,
``pod_look``) and one more (``other``, ``other_pod``, whose last frame lies ``other_age`` before last_seen_ns). The
frames of a third one at the same time count to that other look: too little rather than too much.
"""

from __future__ import annotations

import numba
import numpy as np

#: a step of other_age, nanoseconds: a byte holds 1.275 s
AGE_NS = 5_000_000
_OLDEST = 255
#: steps of other_pod, and of resolution_px for a pixel
POD_STEPS, RESOLUTION_STEPS = 255, 16
MOST_LOOKS, MOST_RESOLUTION = 65_535, 65_535


@numba.njit(cache=True)
def note_look(cell, pod, kept, resolution, time):  # type: ignore[no-untyped-def]
    """Note one frame's view of a cell. pod: of the frame, 0..1. kept: of people there the share whom the frame left
    unfound, so far as it is a look of its own; below 0: not known, and of a look its best frame's pod counts.
    resolution: pixels per person. time: of the frame, the longest pause within a look, ns, and the number of the
    viewpoint, 1..255.
    """
    time_ns, pause_ns, viewpoint = time
    since = max(time_ns - cell.last_seen_ns, 0)
    oldest = np.int64(pause_ns // AGE_NS)
    if cell.looks == 0:
        cell.looks, cell.viewpoint = 1, viewpoint
    else:
        aged = min(np.int64(cell.other_age) + (since + AGE_NS // 2) // AGE_NS, _OLDEST)
        cell.other_age = aged
        is_open, other_is_open = since <= pause_ns, cell.other != 0 and aged <= oldest
        if cell.viewpoint == viewpoint:
            if not is_open:
                _end(cell)
        elif other_is_open and (cell.other == viewpoint or is_open):
            _exchange(cell, viewpoint, since)
        else:
            _begin_beside(cell, viewpoint, since, is_open)
    if kept >= 0.0:
        cell.pod_before = 1.0 - (1.0 - cell.pod_before) * kept
    else:
        cell.pod_look = max(cell.pod_look, np.float32(pod))
    cell.resolution_px = max(
        np.int64(cell.resolution_px), min(np.int64(resolution * RESOLUTION_STEPS), MOST_RESOLUTION)
    )
    cell.last_seen_ns = max(cell.last_seen_ns, time_ns)


@numba.njit(cache=True)
def _end(cell):  # type: ignore[no-untyped-def]
    """The viewpoint's look is over, and another one of it begins."""
    cell.pod_before = 1.0 - (1.0 - cell.pod_before) * (1.0 - cell.pod_look)
    cell.pod_look = 0.0
    cell.looks = min(np.int64(cell.looks) + 1, MOST_LOOKS)


@numba.njit(cache=True)
def _exchange(cell, viewpoint, since):  # type: ignore[no-untyped-def]
    """The other viewpoint, or a third one in its place, has the newest frame now."""
    pod = np.float32(cell.other_pod) / np.float32(POD_STEPS)
    _set_aside(cell, since)
    cell.viewpoint, cell.pod_look = viewpoint, pod


@numba.njit(cache=True)
def _begin_beside(cell, viewpoint, since, is_open):  # type: ignore[no-untyped-def]
    """A viewpoint without an open look begins one; that of the newest frame so far is kept beside it, if it is open."""
    pod = np.float32(cell.other_pod) / np.float32(POD_STEPS)
    cell.pod_before = 1.0 - (1.0 - cell.pod_before) * (1.0 - pod)
    if is_open and cell.viewpoint != 0:
        _set_aside(cell, since)
    else:
        cell.pod_before = 1.0 - (1.0 - cell.pod_before) * (1.0 - cell.pod_look)
        cell.other, cell.other_pod, cell.other_age = 0, 0, 0
    cell.viewpoint, cell.pod_look = viewpoint, 0.0
    cell.looks = min(np.int64(cell.looks) + 1, MOST_LOOKS)


@numba.njit(cache=True)
def _set_aside(cell, since):  # type: ignore[no-untyped-def]
    """The look of the newest frame so far becomes the other one; its POD is rounded down."""
    cell.other, cell.other_pod = cell.viewpoint, np.int64(cell.pod_look * POD_STEPS)
    cell.other_age = min((since + AGE_NS // 2) // AGE_NS, _OLDEST)

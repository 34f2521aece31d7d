"""Covering patterns: which periods together can look at every frame of a stream.

A used detector starts once in every ``period`` frames, so its schedule is nothing but a phase, 0 .. period -
1 (window sums of Eq. ilp_frame_timing that are equal make y periodic). A *covering pattern* is a multiset of
periods whose phases can be chosen so that every frame is looked at between 1 and detPerFrame times (Eq.
ilp_constr_detperframe). With patterns the frame variables of the program fall away.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from functools import lru_cache

from pipeline.errors import NoPlanError

#: multisets of periods that may be looked at; detPerStream 8 with 8 periods are 12,869
MAX_MULTISETS = 200_000

Pattern = tuple[int, ...]


@lru_cache(maxsize=256)
def covering_patterns(periods: tuple[int, ...], per_stream: int, per_frame: int) -> tuple[Pattern, ...]:
    """All covering patterns of at most per_stream detectors, each ascending, in lexical order.

    periods: distinct, ascending. Raises NoPlanError for more than MAX_MULTISETS candidates.
    """
    candidates = sum(math.comb(len(periods) + n - 1, n) for n in range(1, per_stream + 1)) if periods else 0
    if candidates > MAX_MULTISETS:
        raise NoPlanError(
            f"{len(periods)} different periods give {candidates} ways to share a stream among {per_stream} "
            f"detectors, more than {MAX_MULTISETS}; lower detectors_per_stream"
        )
    found = _multisets(periods, per_stream, float(per_frame))
    return tuple(sorted(pattern for pattern in found if phases_of(pattern, per_frame) is not None))


def _multisets(periods: tuple[int, ...], room: int, density: float, low: int = 0) -> Iterator[Pattern]:
    """Multisets of 1 .. room periods whose looks per frame are at most ``density``."""
    if room == 0:
        return
    for i in range(low, len(periods)):
        rest = density - 1.0 / periods[i]
        if rest < -1e-9:
            continue
        yield (periods[i],)
        for more in _multisets(periods, room - 1, rest, i):
            yield (periods[i], *more)


@lru_cache(maxsize=65536)
def phases_of(pattern: Pattern, per_frame: int) -> tuple[int, ...] | None:
    """A phase for each period of the pattern, or None if no choice covers; the first in lexical order.

    Frames are the bits of a number as long as the cycle of the pattern's own periods; covered[k] has the
    frames that are looked at more than k times.
    """
    if sum(1.0 / period for period in pattern) < 1.0 - 1e-9:
        return None
    cycle = math.lcm(*pattern)
    return _choose(pattern, per_frame, cycle, (0,) * (per_frame + 1), ())


@lru_cache(maxsize=65536)
def phases_near(pattern: Pattern, wanted: tuple[int | None, ...], per_frame: int) -> tuple[int, ...] | None:
    """A phase for each period, the wanted ones where they cover; None if no choice covers.

    wanted: by period, None for any; one outside its period counts as any. Not all may be had: they are then
    gone through in order, and each that the others can still be chosen to is kept.
    """
    valid = tuple(w if w is not None and 0 <= w < p else None for w, p in zip(wanted, pattern, strict=True))
    found = _completed(pattern, valid, per_frame)
    if found is not None or not any(phase is not None for phase in valid):
        return found
    found = phases_of(tuple(sorted(pattern)), per_frame)
    if found is None:
        return None
    fixed: tuple[int | None, ...] = (None,) * len(pattern)
    for i, phase in enumerate(valid):
        one_more = (*fixed[:i], phase, *fixed[i + 1 :])
        if phase is not None and _completed(pattern, one_more, per_frame) is not None:
            fixed = one_more
    return _completed(pattern, fixed, per_frame)


def _completed(pattern: Pattern, fixed: tuple[int | None, ...], per_frame: int) -> tuple[int, ...] | None:
    """Phases that cover and include the fixed ones, or None."""
    cycle = math.lcm(*pattern)
    covered = (0,) * (per_frame + 1)
    for period, phase in zip(pattern, fixed, strict=True):
        if phase is not None:
            covered = _add(covered, _frames(period, phase, cycle))
    if covered[per_frame]:
        return None
    free = sorted((i for i, phase in enumerate(fixed) if phase is None), key=lambda i: pattern[i])
    chosen = _choose(
        tuple(pattern[i] for i in free), per_frame, cycle, covered, (), turned=len(free) < len(pattern)
    )
    if chosen is None:
        return None
    by_number = dict(zip(free, chosen, strict=True))
    return tuple(by_number[i] if phase is None else phase for i, phase in enumerate(fixed))


def _choose(
    pattern: Pattern,
    per_frame: int,
    cycle: int,
    covered: tuple[int, ...],
    chosen: tuple[int, ...],
    *,
    turned: bool = False,
) -> tuple[int, ...] | None:
    """turned: the schedule cannot be turned any more, since some phases are fixed already."""
    if len(chosen) == len(pattern):
        return chosen if covered[0] == (1 << cycle) - 1 else None
    left = pattern[len(chosen) :]
    missing = cycle - covered[0].bit_count()
    if missing > sum(cycle // period for period in left):
        return None
    period = left[0]
    # equal periods are interchangeable: their phases ascend
    first = chosen[-1] if chosen and pattern[len(chosen) - 1] == period else 0
    # the schedule can be turned until the first phase is 0
    last = period if chosen or turned else 1
    for phase in range(first, last):
        after = _add(covered, _frames(period, phase, cycle))
        if after[per_frame] == 0:
            found = _choose(pattern, per_frame, cycle, after, (*chosen, phase), turned=turned)
            if found is not None:
                return found
    return None


@lru_cache(maxsize=4096)
def _frames(period: int, phase: int, cycle: int) -> int:
    """The frames f < cycle with f mod period = phase, as bits."""
    return sum(1 << f for f in range(phase, cycle, period))


def _add(covered: tuple[int, ...], frames: int) -> tuple[int, ...]:
    """One more look at the frames."""
    more = [covered[0] | frames]
    for fewer, now in itertools.pairwise(covered):
        more.append(now | (fewer & frames))
    return tuple(more)

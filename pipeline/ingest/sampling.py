"""Which pictures are taken at a processing rate: those at or just before its ticks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.messages import FloatArray


class Timed(Protocol):
    """Something with a time, seconds."""

    @property
    def time_s(self) -> float: ...


T = TypeVar("T", bound=Timed)


def sampled(
    pictures: Iterable[T], rate_hz: float, slack_s: float, last_s: float
) -> Iterator[tuple[T, int | None]]:
    """Every picture, and the number k of the tick k / rate_hz that it is taken for, or None.

    A picture is shown until the next one comes; it is taken if a tick falls into that time, once, for the first
    such tick. slack_s: a picture that comes so much after a tick counts as in time, since its time was rounded.
    last_s: how long the last picture is shown.
    """
    held: T | None = None
    for picture in pictures:
        if held is not None:
            yield held, _tick(held.time_s, picture.time_s, rate_hz, slack_s)
        held = picture
    if held is not None:
        yield held, _tick(held.time_s, held.time_s + last_s, rate_hz, slack_s)


def is_sampled(time_s: float, until_s: float, rate_hz: float, slack_s: float) -> bool:
    """Whether ``sampled`` takes a picture that is shown from time_s until until_s."""
    return _tick(time_s, until_s, rate_hz, slack_s) is not None


def sampled_indices(times_s: FloatArray, rate_hz: float, slack_s: float, last_s: float) -> NDArray[np.int64]:
    """Numbers of the pictures that ``sampled`` takes, int64 (K,). times_s: float64 (N,), increasing."""
    until_s = np.append(times_s[1:], times_s[-1:] + last_s)
    ticks = np.ceil((times_s - slack_s) * rate_hz)
    return np.flatnonzero(ticks < (until_s - slack_s) * rate_hz).astype(np.int64)


def require_rate(rate_hz: float, video_rate_hz: float, where: object = "processing.frame_rate") -> None:
    """Raises InputError if the processing is faster than a video of constant rate."""
    if rate_hz > video_rate_hz * (1.0 + 1e-9):
        raise InputError(where, f"{rate_hz:g} Hz", f"at most the video's {video_rate_hz:g} Hz")


def _tick(time_s: float, until_s: float, rate_hz: float, slack_s: float) -> int | None:
    tick = math.ceil((time_s - slack_s) * rate_hz)
    return tick if tick < (until_s - slack_s) * rate_hz else None

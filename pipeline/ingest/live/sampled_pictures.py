"""What waits between the thread that reads a live stream and whoever looks at its pictures."""

from __future__ import annotations

import math
import threading
from collections import deque
from dataclasses import dataclass

from av.video.frame import VideoFrame

from pipeline.ingest.live.connection import Connection, Shown
from pipeline.ingest.source import LostPicture, PassedPicture, Picture
from pipeline.ingest.video.upright import Upright, upright_of

#: a picture of another shape than the first one's, by more than so much, is of another camera
_SAME_SHAPE = 0.01
#: how often a picture may come at most, Hz, where a stream does not say
_USUAL_HZ = 25.0


@dataclass(frozen=True)
class Shape:
    """size: of the stream's upright pictures, which its camera is of. sent: of the planes. rate_hz: of the processing.

    first_index: of the first picture. most_waiting: pictures; the oldest is given up.
    """

    size: tuple[int, int]
    sent: tuple[int, int]
    rate_hz: float
    first_index: int = 0
    most_waiting: int = 20


class SampledPictures:
    """Pictures of any number of connections, numbered through, on the processing clock.

    A picture is taken if it is the first at a tick or after it: half of a picture's time before counts as at it.
    """

    def __init__(self, shape: Shape) -> None:
        self._shape = shape
        self._index, self._tick, self._time_s = shape.first_index, -1, -math.inf
        self._upright: Upright | None = None
        self._frame_size: tuple[int, int] = (0, 0)
        self._slack_s = 0.5 / _USUAL_HZ
        self._waiting: deque[tuple[float, Picture | LostPicture | PassedPicture]] = deque()
        self._changed = threading.Condition()
        self._ended = False

    def restart(self, connection: Connection) -> None:
        """Another connection: its pictures may be of another size."""
        self._upright = None
        self._slack_s = 0.5 / (connection.rate_hz or _USUAL_HZ)

    def take(self, shown: Shown, time_s: float, connection: Connection) -> None:
        """A picture as it came. time_s: when it was taken, on the stream's clock."""
        item = self._item(shown, time_s, connection)
        with self._changed:
            self._waiting.append((shown.arrival_s, item))
            self._give_up_the_oldest()
            self._changed.notify_all()
        self._index += 1

    def _item(
        self, shown: Shown, time_s: float, connection: Connection
    ) -> Picture | LostPicture | PassedPicture:
        index = self._index
        if shown.frame is None or not math.isfinite(time_s):
            return LostPicture(index, max(self._time_s, 0.0), "damaged")
        if time_s <= self._time_s:
            return LostPicture(index, self._time_s, "out_of_order")
        self._time_s = time_s
        tick = math.floor((time_s + self._slack_s) * self._shape.rate_hz)
        if tick <= self._tick:
            return PassedPicture(index, time_s)
        upright = self._upright_of(shown.frame, connection)
        if not _is_shape(upright.size, self._shape.size):
            return LostPicture(index, time_s, "other_shape")
        self._tick = tick
        return Picture(index, time_s, tick, upright.planes(shown.frame, *self._shape.sent))

    def _upright_of(self, frame: VideoFrame, connection: Connection) -> Upright:
        size = frame.width, frame.height
        if self._upright is None or size != self._frame_size:
            self._upright, self._frame_size = upright_of(frame, connection.aspect), size
        return self._upright

    def _give_up_the_oldest(self) -> None:
        pictures = [k for k, (_, item) in enumerate(self._waiting) if isinstance(item, Picture)]
        for k in pictures[: max(0, len(pictures) - self._shape.most_waiting)]:
            arrival_s, item = self._waiting[k]
            self._waiting[k] = arrival_s, LostPicture(item.index, item.time_s, "source_late")

    def next(self, most_s: float) -> tuple[float, Picture | LostPicture | PassedPicture] | None:
        """The oldest, with its time of arrival; None where none came within a time."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._waiting or self._ended, most_s) or not self._waiting:
                return None
            return self._waiting.popleft()

    @property
    def is_over(self) -> bool:
        """Whether nothing waits, and nothing will."""
        return self._ended and not self._waiting

    def end(self) -> None:
        """Nothing more comes."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()


def _is_shape(size: tuple[int, int], of: tuple[int, int]) -> bool:
    return abs(size[0] * of[1] / (size[1] * of[0]) - 1.0) <= _SAME_SHAPE

"""What waits at a machine for one detector: bounded, and of no consequence for the link that others share.

Why it drops, and does not hold the sender up: all substreams of a stream share one connection, and what is not read
stops them all. Why it does not grant each substream a credit instead: a credit spares the link's bytes, but costs a
round trip whenever it is used up, and its end is the same, a frame that nobody looks at. Why what is dropped is a whole
run of packets: each needs the one before, so after a packet that was not taken only one that stands alone is of use.
The source is asked for one, but only once there is room again: a detector that hangs must not turn its substream into
key frames that nobody takes.

As fast as possible (pace max) nothing may be dropped, since the map must not depend on the machine's speed: there the
inbox makes its sender wait, at most ``patience_s``.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from pipeline.clock import Clock
from pipeline.errors import RunFailedError
from pipeline.messages import Dropped, Message, Packet

BUSY = "machine_busy"


@dataclass(frozen=True)
class InboxParams:
    """packets: that may wait. max_wait_s: a frame that waited longer is decoded, since the next one needs it, but not
    looked at. patience_s: how long a sender is made to wait, where nothing may be dropped, before the detector is
    taken to hang.
    """

    packets: int = 32
    max_wait_s: float = 1.0
    patience_s: float = 120.0

    def __post_init__(self) -> None:
        if self.packets < 1 or not self.max_wait_s > 0.0 or not self.patience_s > 0.0:
            raise ValueError(f"{self}; expected at least one packet, and times above 0")


@dataclass(frozen=True)
class Waiting:
    """A message and when it came: ns UTC, a stamp, and the monotonic clock's seconds."""

    message: Message
    received_ns: int
    received_s: float


class Inbox:
    """Of one substream; ``put`` on the thread that reads, ``get`` on the one that detects.

    drops: whether to drop or to hold the sender up. on_drop(Dropped, reason ``machine_busy``): a packet was not taken.
    want_restart: ask the source for a packet that stands alone. Both are called without the lock.
    """

    def __init__(
        self,
        params: InboxParams,
        clock: Clock,
        *,
        drops: bool,
        on_drop: Callable[[Dropped], None],
        want_restart: Callable[[], None],
    ) -> None:
        self._params, self._clock, self._drops = params, clock, drops
        self._on_drop, self._want_restart = on_drop, want_restart
        self._items: deque[Waiting] = deque()
        self._changed = threading.Condition()
        self._broken, self._asked, self._closed = False, False, False

    def __len__(self) -> int:
        return len(self._items)

    def put(self, message: Message) -> None:
        """Take a message, or drop it; the end of a stream is always taken.

        Raises RunFailedError if nothing may be dropped and the detector takes nothing for patience_s.
        """
        waiting = Waiting(message, self._clock.utc_ns(), self._clock.monotonic_s())
        if not isinstance(message, Packet) or not self._drops:
            self._put_in_time(waiting)
            return
        with self._changed:
            taken, ask = self._take_or_break(waiting, message)
        if not taken:
            self._on_drop(dropped(message, BUSY))
        if ask:
            self._want_restart()

    def get(self) -> Waiting | None:
        """The next message; waits for it. None once the inbox is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._items or self._closed)
            self._changed.notify_all()
            return None if self._closed else self._items.popleft()

    def close(self) -> None:
        """Give out nothing more, and hold nobody up; what waits is thrown away."""
        with self._changed:
            self._closed = True
            self._items.clear()
            self._changed.notify_all()

    def is_late(self, waiting: Waiting) -> bool:
        """Whether it waited too long to be looked at; never where nothing may be dropped."""
        waited_s = self._clock.monotonic_s() - waiting.received_s
        return self._drops and waited_s > self._params.max_wait_s

    def _take_or_break(self, waiting: Waiting, packet: Packet) -> tuple[bool, bool]:
        """Whether the packet was taken, and whether to ask for one that stands alone."""
        if len(self._items) >= self._params.packets:
            self._broken, self._asked = True, False
            return False, False
        if self._broken and not packet.keyframe:
            ask, self._asked = not self._asked, True
            return False, ask
        self._broken = False
        self._items.append(waiting)
        self._changed.notify_all()
        return True, False

    def _put_in_time(self, waiting: Waiting) -> None:
        with self._changed:
            room = self._changed.wait_for(
                lambda: self._closed or self._drops or len(self._items) < self._params.packets,
                self._params.patience_s,
            )
            if not room:
                found = f"took no packet for {self._params.patience_s:g} s"
                raise RunFailedError(f"detector {getattr(waiting.message, 'detector', '?')} {found}")
            if not self._closed:
                self._items.append(waiting)
            self._changed.notify_all()


def dropped(packet: Packet, reason: str) -> Dropped:
    """The message that a packet's frame will not be processed."""
    return Dropped(
        packet.stream, packet.detector, packet.index, packet.time_ns, reason, packet.epoch, packet.sequence
    )

"""One connection as its sender sees it: what was offered, written and read, in bytes since the handshake."""

from __future__ import annotations

import math
import socket
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.errors import ProtocolError
from pipeline.link.feedback import Feedback, FeedbackReader, Read
from pipeline.link.handshake import Session
from pipeline.link.records import HEARTBEAT, record_bytes
from pipeline.messages import Message

#: clocks run apart, by 10 ms in so many seconds at the worst: their difference is found anew, seconds
_CLOCKS_AGREE_S = 10.0


@dataclass(frozen=True, slots=True)
class Passed:
    """nbytes: of a message that was read whole, took_s at most after its first byte was written."""

    nbytes: int
    took_s: float


@dataclass(frozen=True, slots=True, eq=False)
class _Queued:
    """turn: of the link, counted up. plain: sealed when its turn comes. nbytes: of the record. message: None for a
    heartbeat.
    """

    turn: int
    plain: bytes
    nbytes: int
    message: Message | None


class Outgoing:
    """Not locked: its owner is. blocked: the kernel took less than was written. silent: nothing heard for too long.

    paid_bytes: of the link's bucket, taken and not yet written. held_bytes: what the kernel may hold, 0: no limit.
    """

    def __init__(self, name: str, connection: socket.socket, session: Session, now_s: float) -> None:
        self.name, self.socket, self._session = name, connection, session
        self.blocked, self.silent = False, False
        self.paid_bytes, self.held_bytes = 0, 0
        self.heard_s = self.wrote_s = now_s
        self._feedback = FeedbackReader()
        self._queue: deque[_Queued] = deque()
        self._record = bytearray()  # of the head of the queue, once it is being written
        self._offset = 0  # written of it
        self._unread: deque[tuple[int, Message]] = deque()
        self._offered_bytes = self._written_bytes = self._read_bytes = 0
        self._begun: deque[tuple[int, int, float]] = deque()  # end, bytes and beginning of what is being read
        # of our clock over the far end's, the way back included: the least of this and of the last spell
        self._ahead_s = self._last_ahead_s = math.inf
        self._spell_s = now_s

    @property
    def unread_bytes(self) -> int:
        """Offered, and not known to be read."""
        return self._offered_bytes - self._read_bytes

    @property
    def unread(self) -> Sequence[Message]:
        """Messages that are not known to be read whole, oldest first."""
        return [message for _, message in self._unread]

    @property
    def turn(self) -> int | None:
        """Of the next message to be written, if there is one."""
        return self._queue[0].turn if self._queue else None

    def offer(self, turn: int, plain: bytes, message: Message) -> None:
        """Queue a message. plain: its wire form."""
        self._offer(_Queued(turn, plain, record_bytes(plain), message))
        self._unread.append((self._offered_bytes, message))

    def offer_heartbeat(self, turn: int) -> None:
        """Queue a sign of life."""
        self._offer(_Queued(turn, HEARTBEAT, record_bytes(HEARTBEAT), None))

    def _offer(self, queued: _Queued) -> None:
        self._queue.append(queued)
        self._offered_bytes += queued.nbytes

    def chunk(self, most_bytes: int) -> memoryview:
        """What to write next, of one record. Called by the thread that writes, and by no other."""
        if not self._record:
            self._record = self._session.writer.seal(self._queue[0].plain)
        return memoryview(self._record)[self._offset : self._offset + most_bytes]

    def wrote(self, nbytes: int, now_s: float) -> int:
        """The kernel took so much of the chunk; how much of it was messages."""
        head = self._queue[0]
        if nbytes and self._offset == 0:
            self._begun.append((self._written_bytes + head.nbytes, head.nbytes, now_s))
        self._offset += nbytes
        self._written_bytes += nbytes
        self.paid_bytes = max(0, self.paid_bytes - nbytes)
        if nbytes:
            self.wrote_s = now_s
        if self._offset == head.nbytes:
            self._queue.popleft()
            self._record, self._offset = bytearray(), 0
        return 0 if head.message is None else nbytes

    def feedback(self, data: bytes) -> list[Feedback]:
        """What the far end says with these bytes. Raises ProtocolError if they are not from it, or cannot be."""
        return [record for said in self._session.reader.feed(data) for record in self._feedback.feed(said)]

    def heard(self, read: Read, now_s: float) -> tuple[int, float, list[Passed]]:
        """Bytes read since the last time, when, by our clock, and the messages that they complete.

        Raises ProtocolError for what cannot be.
        """
        if not self._read_bytes <= read.total_bytes <= self._written_bytes:
            raise ProtocolError(
                f"{read.total_bytes} bytes are said to be read, of {self._written_bytes} written, "
                f"after {self._read_bytes}"
            )
        at_s = self._by_our_clock(read.at_s, now_s)
        news, self._read_bytes = read.total_bytes - self._read_bytes, read.total_bytes
        while self._unread and self._unread[0][0] <= self._read_bytes:
            self._unread.popleft()
        passed = []
        while self._begun and self._begun[0][0] <= self._read_bytes:
            _, nbytes, begun_s = self._begun.popleft()
            passed.append(Passed(nbytes, at_s - begun_s))
        return news, at_s, passed

    def _by_our_clock(self, at_s: float, now_s: float) -> float:
        """Later than it was by what the quickest record needed for the way back."""
        if now_s - self._spell_s > _CLOCKS_AGREE_S:
            self._last_ahead_s, self._ahead_s, self._spell_s = self._ahead_s, math.inf, now_s
        self._ahead_s = min(self._ahead_s, now_s - at_s)
        return at_s + min(self._ahead_s, self._last_ahead_s)

"""Why a live stream cannot be had."""

from __future__ import annotations


class LiveFaultError(Exception):
    """The reason, in words without the stream's address. for_good: waiting does not mend it.

    ended: the sender said that the stream is over, or went.
    """

    def __init__(self, reason: str, *, for_good: bool = False, ended: bool = False) -> None:
        super().__init__(reason)
        self.for_good, self.ended = for_good, ended

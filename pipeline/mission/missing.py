"""Sends of a stream that is encoded again from its start only what the reducer does not hold yet."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable

from pipeline.messages import Message, Packet


class WhatIsMissing:
    """Deliver to put in front of a detector. A decoder needs every packet from the last one that stands alone on.

    So known packets are kept back until one is missing: then it follows them, and so does the rest of its group. The
    results of those that were known come a second time, and the reducer takes each once.
    """

    def __init__(self, deliver: Callable[[str, Message], None], holds: Callable[[Message], bool]) -> None:
        """deliver(detector, message). holds(message): whether what is made of a message is known."""
        self._deliver, self._holds = deliver, holds
        #: by detector, known packets since the last that stands alone; None: one is missing, all are sent
        self._kept_back: defaultdict[str, list[Packet] | None] = defaultdict(list)

    def __call__(self, detector: str, message: Message) -> None:
        """As deliver."""
        if not isinstance(message, Packet):
            self._send_if_missing(detector, message)
            return
        if message.keyframe:
            self._kept_back[detector] = []
        kept_back = self._kept_back[detector]
        if kept_back is not None and self._holds(message):
            kept_back.append(message)
            return
        for packet in kept_back or ():
            self._deliver(detector, packet)
        self._kept_back[detector] = None
        self._deliver(detector, message)

    def _send_if_missing(self, detector: str, message: Message) -> None:
        if not self._holds(message):
            self._deliver(detector, message)

"""What an actor may say on a channel: a drone speaks for its own stream, a machine for its own detectors.

A key that was taken with a lost drone, or a program that has gone wrong there, then harms what that drone does, and
nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.messages import Detections, Dropped, EndOfStream, Message, Packet
from pipeline.mission.controller.state import machine_actor, source_actor

#: why a message of a known actor is not taken
REFUSED = ("from_the_future", "unknown_substream", "wrong_detector", "wrong_kind", "wrong_stream")


def refused_by_machine(peer: str, message: Message) -> str | None:
    """Why a machine does not take a message of this actor, in a word to count by; None: it does."""
    if not isinstance(message, Packet | EndOfStream):
        return "wrong_kind"
    return None if peer == source_actor(message.stream) else "wrong_stream"


def refused_by_reducer(peer: str, message: Message, machine_of: Mapping[str, str]) -> str | None:
    """The same for the reducer. machine_of: where each detector runs, as far as that is known."""
    if not isinstance(message, Detections | Dropped | EndOfStream):
        return "wrong_kind"
    machine = machine_of.get(message.detector)
    if machine is None:
        return "unknown_substream"
    return None if peer == machine_actor(machine) else "wrong_detector"

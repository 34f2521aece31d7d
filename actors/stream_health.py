"""What an operator is told of live streams: each change once."""

from __future__ import annotations

from dataclasses import dataclass, field

from pipeline.ingest.live.health import CAPTURE_TIMES, Health
from pipeline.mission.controller.orders import Say


@dataclass
class StreamHealths:
    """Of all live streams of a run."""

    known: dict[str, Health] = field(default_factory=dict)

    def told(self, stream: str, health: Health) -> list[Say]:
        """What is new of a stream."""
        before = self.known.get(stream, Health("waiting"))
        # of a silence its greatest length is kept, to be told when it is over
        self.known[stream] = health
        said = []
        if health.state != before.state:
            said.append(self._of_state(stream, before, health))
        elif health.state == "flows" and health.connections != before.connections:
            said.append(Say("flows again", stream, health.sentence))
        if health.state == "flows" and before.state == "flows" and health.basis != before.basis:
            said.append(Say("capture times", stream, CAPTURE_TIMES[health.basis]))
        if health.pose_fault != before.pose_fault:
            said.append(Say("no poses" if health.pose_fault else "poses again", stream, health.pose_fault))
        return said

    @staticmethod
    def _of_state(stream: str, before: Health, health: Health) -> Say:
        if health.state == "silent":
            return Say("silent", stream, health.sentence)
        if health.state == "over":
            return Say("over", stream, health.sentence)
        what = "flows again" if before.state == "silent" else "flows"
        return Say(what, stream, health.sentence)

"""What a run in real time remembers: the controller's log, the time line, what was run, and what its operator asks."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from actors.scheduler import Heard
from pipeline.allocation.plan import Assignment
from pipeline.logs import ACTOR_LOGS, Log
from pipeline.mission.area_change import AreaInFlight
from pipeline.mission.controller.events import Event
from pipeline.mission.controller.orders import Run, Say
from pipeline.mission.controller.recorded import Recorded
from pipeline.mission.controller.state import MissionState, begin
from pipeline.mission.controller_log import CONTROLLER_LOG, ControllerLog
from pipeline.mission.operator import OperatorsDesk
from pipeline.mission.prepared import PreparedMission
from pipeline.outputs.timeline import TimelineEntry
from pipeline.storage.whole_or_nothing import make_folder

_LOG = Log("actors")


@dataclass
class LiveRecord:
    """begun_s: of the caller's monotonic clock. state, log: where a scheduler that is started again goes on: from a
    state that it gave, with what was heard since.
    """

    begun_s: float
    state: MissionState
    file: ControllerLog
    desk: OperatorsDesk
    area: AreaInFlight
    log: list[Recorded] = field(default_factory=list)
    timeline: list[TimelineEntry] = field(default_factory=list)
    ran: dict[tuple[str, str], Assignment] = field(default_factory=dict)
    seen: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, prepared: PreparedMission, run: Path, begun_s: float, here: Collection[str]) -> LiveRecord:
        """A new one. run: the run directory. here: sites on this host."""
        make_folder(run / ACTOR_LOGS)
        file = ControllerLog(run / ACTOR_LOGS / CONTROLLER_LOG, prepared.problem, begun_s, here)
        area = AreaInFlight(prepared, run)
        desk = OperatorsDesk(run, [s.stream for s in prepared.streams], area.change)
        return cls(begun_s, begin(prepared.problem, begun_s, here=here), file, desk, area)

    @property
    def losses(self) -> Counter[str]:
        """How often each actor was lost."""
        return Counter(entry.subject for entry in self.timeline if entry.what == "lost")

    def asked_by_the_operator(self) -> list[Event]:
        """Since the last call."""
        events = self.desk.events()
        for text in self.area.said():
            self.note(Say("search area", "mission", text), time.monotonic())
        return events

    def take(self, heard: Heard) -> None:
        """What the controller has taken and ordered."""
        self.log += heard.recorded
        if heard.state is not None:
            self.state = heard.state
            self.log.clear()
        self.file.append(heard.recorded)
        for one in heard.recorded:
            for order in one.orders:
                if isinstance(order, Run):
                    self.ran |= {
                        (o.assignment.stream, o.assignment.detector): o.assignment for o in order.substreams
                    }

    def note(self, say: Say, now_s: float) -> None:
        """One line for the operator."""
        entry = TimelineEntry(round(now_s - self.begun_s, 3), say.what, say.subject, say.detail)
        self.timeline.append(entry)
        _LOG.event(say.what, subject=say.subject, detail=say.detail)

    def looked_at(self, frames: Mapping[str, int], now_s: float) -> None:
        """Note the streams of which the map has something for the first time. frames: so far, by stream."""
        for stream, count in frames.items():
            if count and stream not in self.seen:
                self.seen.add(stream)
                self.note(Say("first result", stream), now_s)

    def close(self) -> None:
        """The mission is over."""
        self.file.close()
        self.desk.close()

"""What the actors say of themselves while a run goes on, as ``status.json`` of its live view."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from actors.metrics import Snapshot, frame_outcomes
from pipeline.allocation.plan import Assignment
from pipeline.mission.live_files import plan_lines, write_status
from pipeline.mission.prepared import PreparedMission
from pipeline.outputs.timeline import TimelineEntry

#: between two writings, seconds
PERIOD_S = 1.0


class LiveStatus:
    """Writes it, at most once in PERIOD_S. folder: ``live/``; nothing is written where there is none."""

    def __init__(self, folder: Path, prepared: PreparedMission, pace: str) -> None:
        self._folder, self._prepared, self._pace = folder, prepared, pace
        self._due_s, self._begun_s = 0.0, math.nan

    def write_if_due(
        self,
        snapshot: Snapshot,
        now_s: float,
        timeline: Sequence[TimelineEntry] = (),
        assignments: Sequence[Assignment] = (),
        lost: Sequence[str] = (),
    ) -> None:
        """timeline, assignments, lost: in real time, what happened, what was run so far, who does not answer."""
        if math.isnan(self._begun_s):
            self._begun_s = now_s
        if now_s < self._due_s or not self._folder.is_dir():
            return
        self._due_s = now_s + PERIOD_S
        head: dict[str, Any] = {"mission": self._prepared.mission.name, "pace": self._pace}
        head["seconds"] = round(now_s - self._begun_s, 1)
        plan = plan_lines(assignments or snapshot.plan.assignments)
        events = [asdict(entry) for entry in timeline]
        write_status(
            self._folder, head | {"plan": plan, "timeline": events, "lost": list(lost)} | _said(snapshot)
        )


def _said(snapshot: Snapshot) -> dict[str, Any]:
    """Streams with their frames by outcome, machines with what waits there, links as measured."""
    streams, links = {}, []
    for name, source in snapshot.sources.items():
        outcomes = frame_outcomes(source, snapshot.reducer)
        streams[name] = {
            "captured": max(source.frames_done, source.sampled),
            "in_all": source.frames_total,
            "reached_s": round(source.reached_s, 3),
            "finished": source.finished,
            "processed": outcomes.pop("processed", 0),
            "in_flight": outcomes.pop("in_flight"),
            "contradiction": outcomes.pop("contradiction"),
            "dropped": {reason: count for reason, count in outcomes.items() if count},
        }
        for site, link in source.links.items():
            rate = link.rate_bps if math.isfinite(link.rate_bps) else None
            backlog = round(link.backlog_s, 3) if math.isfinite(link.backlog_s) else None
            sent = source.bytes_sent.get(site, 0)
            links.append(
                {"stream": name, "site": site, "rate_bps": rate, "backlog_s": backlog, "lost": link.lost}
                | {"down": dict(link.down), "full": link.full, "sent_bytes": sent}
            )
    machines = {
        name: {"waiting": sum(machine.waiting.values()), "rejected": sum(machine.rejected.values())}
        for name, machine in snapshot.machines.items()
    }
    return {"streams": streams, "links": links, "machines": machines}

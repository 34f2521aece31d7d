"""The actors of one run, their channels, and who watches them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from actors.calls import NoAnswerError, get, kill, named, remote, remote_here
from actors.live_status import LiveStatus
from actors.machine import MachineActor, machine_params
from actors.metrics import RunCollector, Snapshot
from actors.nodes import Offer, offered
from actors.reducer import ReducerActor
from actors.scheduler import SchedulerActor
from actors.source import Pace, SourceActor
from pipeline.allocation.plan import Plan
from pipeline.errors import InputError, SearchlightError, in_one_line
from pipeline.ingest.finding import Finding
from pipeline.link.keys import Endpoint
from pipeline.link.sender import LinkState
from pipeline.logs import Log
from pipeline.mission.controller.state import machine_actor, source_actor
from pipeline.mission.ledger import count_known_to
from pipeline.mission.local import FinishedRun, bandwidth, cut_off_at, make_reducer, source_params
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.run_journal import RunJournal, journal_findings
from pipeline.mission.stages.reducer import ReducerStage
from pipeline.mission.stages.source import SourceCount, StreamInput
from pipeline.mission.stopping import Stop, nothing_yet
from pipeline.outputs.live_names import LIVE
from pipeline.outputs.partial import CutOff, Partial

_LOG = Log("actors")
#: how often the actors are asked how they are, seconds
POLL_S = 0.25
#: at the end of a run that was cut off, an actor that says nothing for so long is dead, or as good as dead, seconds
LAST_WORD_S = 3.0


@dataclass(frozen=True)
class RunOptions:
    """address: of a Ray cluster, or None to start one. metrics_port: None for no /metrics, 0 for any port."""

    pace: Pace = "max"
    address: str | None = None
    metrics_port: int | None = None
    metrics_host: str = "127.0.0.1"


class Wiring:
    """Creates the actors of one run, joins their channels, and watches them."""

    def __init__(self, prepared: PreparedMission, options: RunOptions, stop: Stop) -> None:
        self._prepared, self._options, self._stop = prepared, options, stop
        self._sources: dict[str, Any] = {}
        self._machines: dict[str, Any] = {}
        self._reducer: Any = None
        self._started = 0.0
        self._live: LiveStatus | None = None

    def __enter__(self) -> Wiring:
        return self

    @cached_property
    def _models(self) -> Offer:
        """What nodes of a cluster may lack; a node of our own has what we have."""
        return Offer() if self._options.address is None else offered(self._prepared.pool.detectors)

    def __exit__(self, *_: object) -> None:
        """On a cluster that goes on without us nothing of ours may stay."""
        for actor in (*self._sources.values(), *self._machines.values(), self._reducer):
            if actor is not None:
                kill(actor)

    def plan(self) -> Plan:
        scheduler = remote_here(SchedulerActor).remote(self._prepared)
        plan: Plan = get(scheduler.plan.remote(), "the scheduler")
        kill(scheduler)
        return plan

    def run(
        self,
        plan: Plan,
        journal: RunJournal,
        progress: Callable[[str, int, int], None],
        collector: RunCollector,
    ) -> FinishedRun:
        """To the streams' end; or what there is of it, if somebody stops it or a part fails."""
        self._snapshot = Snapshot(
            plan, bandwidth_bps=self._used_links(plan), findings=self._prepared.findings
        )
        self._started = time.monotonic()
        self._live = LiveStatus(journal.folder.parent / LIVE, self._prepared, self._options.pace)
        try:
            self._start(plan, journal)
            _LOG.event("actors started", machines=sorted({a.machine for a in plan.assignments}))
            self._stop.awaited = True
            self._supervise(progress, collector)
        except InputError:
            raise
        except SearchlightError as error:
            _LOG.warning("a part failed", error=str(error))
            self._stop.ask(f"failed: {in_one_line(error)}")
            return self._ended_early(plan, journal, error)
        if self._stop.reason is not None:
            return self._ended_early(plan, journal, None)
        return self._result(plan)

    def _start(self, plan: Plan, journal: RunJournal) -> None:
        self._reducer = remote_here(ReducerActor).remote(self._prepared, plan, None, False, journal)
        codec = self._prepared.mission.processing.codec
        sites = {a.machine: a.site for a in plan.assignments}
        self._machines = {
            machine: remote(MachineActor, site).remote(machine, None, codec, machine_params(self._prepared))
            for machine, site in sites.items()
        }
        self._sources = {
            s.stream: remote(SourceActor, s.site).remote(
                s,
                plan.assignments,
                bandwidth(self._prepared, plan, s.stream),
                source_params(self._prepared),
            )
            for s in self._prepared.streams
        }
        endpoints = self._start_machines(plan)
        known = get(self._reducer.acknowledged.remote(), "the reducer")
        self._started = time.monotonic()
        for stream, source in self._sources.items():
            get(source.start.remote(endpoints, known), f"the source of {stream}")

    def _supervise(self, progress: Callable[[str, int, int], None], collector: RunCollector) -> None:
        """Until the streams have ended, or somebody asks to stop."""
        while self._stop.reason is None:
            before, self._snapshot = self._snapshot, self._polled(self._snapshot)
            self._log_ends(before, self._snapshot)
            collector.snapshot = self._snapshot
            self._live_status()
            for source in self._snapshot.sources.values():
                progress(source.stream, source.frames_done, source.frames_total)
            if self._is_done(self._snapshot):
                return
            time.sleep(POLL_S)

    def _live_status(self) -> None:
        if self._live is not None:
            self._live.write_if_due(self._snapshot, time.monotonic())

    def _start_machines(self, plan: Plan) -> dict[str, Endpoint]:
        """Each by detector. Everybody is told first whose keys to accept."""
        reducer = get(self._reducer.endpoint.remote(), "the reducer")
        machines = {machine_actor(name): handle for name, handle in self._machines.items()}
        get(self._reducer.accept_only.remote(_public_keys(machines)), "the reducer")
        sources = _public_keys({source_actor(name): handle for name, handle in self._sources.items()})
        for actor in self._machines.values():
            actor.accept_only.remote(sources)
        given = {m: tuple(a for a in plan.assignments if a.machine == m) for m in self._machines}
        used = {a.pool_detector: self._prepared.runnable(a.pool_detector) for a in plan.assignments}
        started = {
            m: actor.start.remote(given[m], used, reducer, self._prepared.layers, self._models)
            for m, actor in self._machines.items()
        }
        return {a.detector: get(started[a.machine], f"machine {a.machine}") for a in plan.assignments}

    def _polled(self, last: Snapshot) -> Snapshot:
        """What everybody says now. The reducer first: what it has taken, the sources have then sent."""
        asked = {"the reducer": self._reducer.status.remote()}
        asked |= {f"machine {name}": m.status.remote() for name, m in self._machines.items()}
        answers = {who: self._answer(what, who) for who, what in asked.items()}
        sources = {
            name: self._answer(s.status.remote(), f"the source of {name}")
            for name, s in self._sources.items()
        }
        if self._stop.reason is not None:
            return last
        for who, status in {**answers, **{f"the source of {n}": s for n, s in sources.items()}}.items():
            if status.error is not None:
                raise named(status.error, who)
        machines = {name: answers[f"machine {name}"] for name in self._machines}
        return replace(last, sources=sources, machines=machines, reducer=answers["the reducer"])

    def _answer(self, what: Any, who: str) -> Any:
        """An actor's answer; None once somebody has asked to stop."""
        while self._stop.reason is None:
            with suppress(NoAnswerError):
                return get(what, who, POLL_S)
        return None

    @staticmethod
    def _log_ends(before: Snapshot, now: Snapshot) -> None:
        """A line for every source that has come to its end, and for the reducer's last substream."""
        for stream, source in now.sources.items():
            known = before.sources.get(stream)
            if source.finished and not (known is not None and known.finished):
                _LOG.event("stream ends", stream=stream, frames=source.frames_done)
        was = None if before.reducer is None else before.reducer.open_substreams
        if now.reducer is not None and now.reducer.open_substreams != was:
            _LOG.event("substreams open", count=now.reducer.open_substreams)

    @staticmethod
    def _is_done(snapshot: Snapshot) -> bool:
        sent = all(source.finished for source in snapshot.sources.values())
        return sent and snapshot.reducer is not None and snapshot.reducer.open_substreams == 0

    def _result(self, plan: Plan) -> FinishedRun:
        seconds = time.monotonic() - self._started
        stage, findings = get(self._reducer.finish.remote(), "the reducer")
        counts = {
            name: get(source.count.remote(), f"the source of {name}")
            for name, source in self._sources.items()
        }
        return self._finished(plan, stage, counts, seconds, findings)

    def _ended_early(self, plan: Plan, journal: RunJournal, error: SearchlightError | None) -> FinishedRun:
        """What there is when somebody has stopped the run, or a part of it has failed. Raises the error, or
        StoppedError, if nothing was taken.
        """
        self._drain()
        seconds = time.monotonic() - self._started
        stage, findings = self._salvaged(plan, journal)
        if not any(stage.received.values()) and not any(stage.dropped.values()):
            raise error or nothing_yet(str(self._stop.reason))
        counts = {}
        for s in self._prepared.streams:
            try:
                counts[s.stream] = get(
                    self._sources[s.stream].count.remote(), "", min(LAST_WORD_S, self._stop.wait_s)
                )
            except (SearchlightError, KeyError):
                counts[s.stream] = count_known_to(s.stream, stage)
        cut_off = tuple(self._cut_off(s, stage) for s in self._prepared.streams if not self._at_end(s.stream))
        partial = Partial(str(self._stop.reason), self._stop.at_ns, cut_off)
        finished = self._finished(plan, stage, counts, seconds, findings)
        return replace(finished, partial=partial, error=error)

    def _finished(
        self,
        plan: Plan,
        stage: ReducerStage,
        counts: dict[str, SourceCount],
        seconds: float,
        findings: tuple[Finding, ...],
    ) -> FinishedRun:
        bytes_sent, links = self._bytes_sent(), self._links()
        pace = self._options.pace
        return FinishedRun(plan, stage, counts, bytes_sent, seconds, pace, links=links, findings=findings)

    def _drain(self) -> None:
        """Tell the sources to stop, and wait for what is on its way, as long as there is time and it gets less."""
        for source in self._sources.values():
            source.stop.remote(self._stop.wait_s)
        missing, since_s = math.inf, time.monotonic()
        while self._stop.wait_s > 0.0 and time.monotonic() - since_s < LAST_WORD_S:
            try:
                reducer = get(self._reducer.status.remote(), "the reducer", self._stop.wait_s)
                sources = {
                    n: get(s.status.remote(), n, min(LAST_WORD_S, self._stop.wait_s))
                    for n, s in self._sources.items()
                }
            except (SearchlightError, AttributeError):  # it is gone, or was never there
                return
            self._snapshot = replace(self._snapshot, sources=sources, reducer=reducer)
            sent = sum(sum(source.packets_sent.values()) for source in sources.values())
            now_missing = sent - sum(reducer.taken.values())
            if now_missing <= 0 and all(source.finished for source in sources.values()):
                return
            if now_missing < missing:
                missing, since_s = now_missing, time.monotonic()
            time.sleep(POLL_S / 5.0)

    def _salvaged(self, plan: Plan, journal: RunJournal) -> tuple[ReducerStage, tuple[Finding, ...]]:
        """The reducer's state: from itself, or if it does not answer, from what it has put on the disk."""
        with suppress(SearchlightError, AttributeError):
            answer: tuple[ReducerStage, tuple[Finding, ...]] = get(
                self._reducer.finish.remote(), "the reducer", max(LAST_WORD_S, self._stop.wait_s)
            )
            return answer
        if self._reducer is not None:
            kill(self._reducer)
        _LOG.warning("reducer does not answer: its journal is read", folder=journal.folder)
        stage = make_reducer(self._prepared, plan, lateness=self._options.pace == "realtime")
        durable = journal.reducer(stage, time.monotonic())
        durable.finish()
        return stage, journal_findings(durable)

    def _at_end(self, stream: str) -> bool:
        source = self._snapshot.sources.get(stream)
        return source is not None and source.finished and not source.cut_off

    def _cut_off(self, stream: StreamInput, stage: ReducerStage) -> CutOff:
        """Where a stream was cut off: by its source, or if that is gone, by the newest frame that came."""
        source = self._snapshot.sources.get(stream.stream)
        if source is not None:
            return cut_off_at(stream, stream.video.start_s + source.reached_s)
        newest = [ns for (name, _), ns in stage.fuser.last_ns.items() if name == stream.stream]
        video_s = max(newest, default=stream.start_ns) - stream.start_ns
        return cut_off_at(stream, max(stream.video.start_s, video_s * 1e-9))

    def _bytes_sent(self) -> dict[tuple[str, str], int]:
        sources = self._snapshot.sources.items()
        return {(n, site): b for n, source in sources for site, b in source.bytes_sent.items()}

    def _links(self) -> dict[tuple[str, str], LinkState]:
        sources = self._snapshot.sources.items()
        return {(n, site): state for n, source in sources for site, state in source.links.items()}

    def _used_links(self, plan: Plan) -> dict[tuple[str, str], float]:
        used = {(a.stream, a.site) for a in plan.assignments}
        return {link: self._prepared.problem.link_bps.get(link, 0.0) for link in sorted(used)}


def _public_keys(actors: Mapping[str, Any]) -> dict[bytes, str]:
    """The names of actors by the public keys that they have made."""
    asked = {name: handle.public_key.remote() for name, handle in actors.items()}
    return {get(key, name): name for name, key in asked.items()}

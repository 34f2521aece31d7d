"""Wiring and supervision of one run: the one place that calls ray.remote."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from actors.cluster import cluster
from actors.machine import MachineActor
from actors.metrics import RunCollector, Snapshot, serve
from actors.reducer import ReducerActor
from actors.scheduler import SchedulerActor
from actors.site import placement
from actors.source import Pace, SourceActor
from pipeline.allocation.plan import Plan
from pipeline.errors import RunFailedError, SearchlightError
from pipeline.logs import Log
from pipeline.mission.clocks import pacing_offsets_s
from pipeline.mission.local import FinishedRun, bandwidth, source_params
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.stages.reducer import ReducerStage

_LOG = Log("actors")
#: how often the actors are asked how they are, seconds
POLL_S = 0.25
#: sources begin so long after everybody is ready, seconds (realtime)
START_DELAY_S = 1.0


@dataclass(frozen=True)
class RunOptions:
    """address: of a Ray cluster, or None to start one. metrics_port: None for no /metrics, 0 for any port."""

    pace: Pace = "max"
    address: str | None = None
    metrics_port: int | None = None
    metrics_host: str = "127.0.0.1"


def run_on_ray(
    prepared: PreparedMission,
    options: RunOptions,
    progress: Callable[[str, int, int], None],
    say: Callable[[str], None],
) -> FinishedRun:
    """Plan and run. progress(stream, frames done, frames in all); say(one line) for each phase."""
    with _metrics(options, say) as collector:
        _LOG.event("ray", address=options.address or "started here", pace=options.pace)
        say("starting Ray" if options.address is None else f"joining Ray at {options.address}")
        return _run(prepared, options, collector, progress, say)


def _run(
    prepared: PreparedMission,
    options: RunOptions,
    collector: RunCollector,
    progress: Callable[[str, int, int], None],
    say: Callable[[str], None],
) -> FinishedRun:
    with cluster(options.address, [site.id for site in prepared.inventory.sites]) as host:
        wiring = _Wiring(prepared, options, host)
        say("planning")
        plan = wiring.plan()
        say(f"plan: {plan.status}, objective {plan.objective:.4g}, {len(plan.assignments)} substreams")
        wiring.start(plan)
        _LOG.event("actors started", machines=sorted({a.machine for a in plan.assignments}))
        return wiring.supervise(plan, progress, collector)


@contextmanager
def _metrics(options: RunOptions, say: Callable[[str], None]) -> Iterator[RunCollector]:
    """The collector behind /metrics, which is served, if asked for, before anything else is started."""
    collector = RunCollector()
    if options.metrics_port is None:
        yield collector
        return
    server = serve(collector, options.metrics_port, options.metrics_host)
    say(f"metrics at http://{options.metrics_host}:{server.server_port}/metrics")
    try:
        yield collector
    finally:
        server.shutdown()
        server.server_close()


class _Wiring:
    """Creates the actors of one run, joins their channels, and watches them."""

    def __init__(self, prepared: PreparedMission, options: RunOptions, host: str) -> None:
        self._prepared, self._options, self._host = prepared, options, host
        self._token = secrets.token_bytes(32)
        self._sources: dict[str, Any] = {}
        self._machines: dict[str, Any] = {}
        self._reducer: Any = None
        self._started = 0.0

    def plan(self) -> Plan:
        scheduler = _remote(SchedulerActor, None).remote(self._prepared)
        plan: Plan = _get(scheduler.plan.remote())
        _kill(scheduler)
        return plan

    def start(self, plan: Plan) -> None:
        realtime = self._options.pace == "realtime"
        self._reducer = _remote(ReducerActor, None).remote(
            self._prepared, plan, self._host, self._token, realtime
        )
        codec = self._prepared.mission.processing.codec
        sites = {a.machine: a.site for a in plan.assignments}
        self._machines = {
            machine: _remote(MachineActor, site).remote(machine, self._host, self._token, codec)
            for machine, site in sites.items()
        }
        self._sources = {
            s.stream: _remote(SourceActor, s.site).remote(
                s,
                plan.assignments,
                bandwidth(self._prepared, plan, s.stream),
                self._token,
                source_params(self._prepared),
            )
            for s in self._prepared.streams
        }
        addresses = self._start_machines(plan, realtime)
        start_s = time.time() + START_DELAY_S
        streams = self._prepared.streams
        offsets_s = pacing_offsets_s(
            [s.start_ns for s in streams], [s.end_s - s.video.start_s for s in streams]
        )
        self._started = time.monotonic()
        for s, offset_s in zip(streams, offsets_s, strict=True):
            _get(self._sources[s.stream].start.remote(addresses, self._options.pace, start_s + offset_s))

    def supervise(
        self, plan: Plan, progress: Callable[[str, int, int], None], collector: RunCollector
    ) -> FinishedRun:
        snapshot = Snapshot(plan, bandwidth_bps=self._used_links(plan), findings=self._prepared.findings)
        while True:
            before, snapshot = snapshot, self._snapshot(snapshot)
            self._log_ends(before, snapshot)
            collector.snapshot = snapshot
            for source in snapshot.sources.values():
                progress(source.stream, source.frames_done, source.frames_total)
            if self._is_done(snapshot):
                return self._result(plan, snapshot)
            time.sleep(POLL_S)

    def _start_machines(self, plan: Plan, realtime: bool) -> dict[str, tuple[str, int]]:
        reducer_address = _get(self._reducer.address.remote())
        given = {m: tuple(a for a in plan.assignments if a.machine == m) for m in self._machines}
        used = {a.pool_detector: self._prepared.runnable(a.pool_detector) for a in plan.assignments}
        started = {
            m: actor.start.remote(given[m], used, reducer_address, realtime, self._prepared.layers)
            for m, actor in self._machines.items()
        }
        return {a.detector: _get(started[a.machine]) for a in plan.assignments}

    def _snapshot(self, last: Snapshot) -> Snapshot:
        sources = _get([s.status.remote() for s in self._sources.values()])
        machines = _get([m.status.remote() for m in self._machines.values()])
        reducer = _get(self._reducer.status.remote())
        for status in [*sources, *machines, reducer]:
            if status.error is not None:
                raise status.error
        return replace(
            last,
            sources={s.stream: s for s in sources},
            machines={m.machine: m for m in machines},
            reducer=reducer,
        )

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

    def _result(self, plan: Plan, snapshot: Snapshot) -> FinishedRun:
        seconds = time.monotonic() - self._started
        stage: ReducerStage = _get(self._reducer.finish.remote())
        counts = {name: _get(source.count.remote()) for name, source in self._sources.items()}
        sent = {
            (n, site): b for n, source in snapshot.sources.items() for site, b in source.bytes_sent.items()
        }
        links = {(n, site): s for n, source in snapshot.sources.items() for site, s in source.links.items()}
        return FinishedRun(plan, stage, counts, sent, seconds, self._options.pace, links=links)

    def _used_links(self, plan: Plan) -> dict[tuple[str, str], float]:
        used = {(a.stream, a.site) for a in plan.assignments}
        return {link: self._prepared.problem.link_bps.get(link, 0.0) for link in sorted(used)}


def _remote(actor: type, site: str | None) -> Any:
    import ray

    resources: Mapping[str, float] = {} if site is None else placement(site)
    return ray.remote(actor).options(num_cpus=0, resources=dict(resources))


def _get(what: Any) -> Any:
    import ray

    try:
        return ray.get(what)
    except ray.exceptions.RayTaskError as error:
        if isinstance(error.cause, SearchlightError):
            raise error.cause from None
        raise RunFailedError(str(error)) from None
    except ray.exceptions.RayError as error:
        raise RunFailedError(f"{type(error).__name__}: {error}") from None


def _kill(actor: Any) -> None:
    import ray

    ray.kill(actor)

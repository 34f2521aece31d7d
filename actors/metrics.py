"""Prometheus metrics of a run, from the newest snapshot of its actors."""

from __future__ import annotations

import platform
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from wsgiref.simple_server import WSGIServer

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.registry import Collector

from actors.actor_metrics import actor_usage
from actors.heard import Heard
from actors.machine import MachineStatus
from actors.map_metrics import map_metrics
from actors.reducer import ReducerStatus
from actors.source import SourceStatus
from actors.steady_counts import SteadyCounts
from pipeline.allocation.plan import Plan
from pipeline.errors import InputError
from pipeline.ingest.finding import Finding
from pipeline.link.receiver import REJECTED
from pipeline.mission.stages.latency import LATENCY_BUCKETS_S
from pipeline.mission.who_may_say import REFUSED
from pipeline.outputs.verdict import doubts_of


@dataclass(frozen=True)
class Snapshot:
    """What the supervisor last heard of everybody. bandwidth_bps: (stream, site) -> limit. findings: of the checks.

    losses: how often each actor was lost (realtime).
    """

    plan: Plan
    sources: Mapping[str, SourceStatus] = field(default_factory=dict)
    reducer: ReducerStatus | None = None
    bandwidth_bps: Mapping[tuple[str, str], float] = field(default_factory=dict)
    machines: Mapping[str, MachineStatus] = field(default_factory=dict)
    findings: Sequence[Finding] = ()
    losses: Mapping[str, int] = field(default_factory=dict)

    @property
    def statuses(self) -> dict[str, SourceStatus | MachineStatus | ReducerStatus]:
        """By actor."""
        said: dict[str, SourceStatus | MachineStatus | ReducerStatus] = {}
        said |= {f"source:{name}": status for name, status in self.sources.items()}
        said |= {f"machine:{name}": status for name, status in self.machines.items()}
        return said | ({"reducer": self.reducer} if self.reducer is not None else {})


class RunCollector(Collector):
    """Turns each snapshot into metrics, which a scrape is given; there are none before there is a plan.

    clock: seconds, monotonic, and since 1970.
    """

    def __init__(
        self,
        snapshot: Snapshot | None = None,
        clock: Callable[[], float] = time.monotonic,
        utc: Callable[[], float] = time.time,
    ) -> None:
        self._clock, self._utc = clock, utc
        self._steady, self._metrics, self._scrapes = SteadyCounts(), tuple[Metric, ...](), 0
        self._heard = Heard()
        if snapshot is not None:
            self.snapshot = snapshot

    @property
    def snapshot(self) -> Snapshot | None:
        """The newest one."""
        return self._snapshot

    @snapshot.setter
    def snapshot(self, snapshot: Snapshot) -> None:
        self._snapshot = snapshot
        self._heard.take(snapshot.statuses, self._utc())
        self._metrics = tuple(self._of(snapshot))

    _snapshot: Snapshot | None = None

    def collect(self) -> Iterable[Metric]:
        """All metrics of the run; their names begin with searchlight_."""
        self._scrapes += 1
        return self._metrics

    def last_scrape(self, within_s: float) -> None:
        """At the end of a run: all is final. Whoever has watched is given so long to fetch it."""
        if self._snapshot is None:
            return
        self._steady.settle_s = 0.0
        self._metrics = tuple(self._of(self._snapshot))
        scrapes, until_s = self._scrapes, self._clock() + within_s
        while 1 < scrapes == self._scrapes and self._clock() < until_s:
            time.sleep(0.05)

    def _of(self, snapshot: Snapshot) -> Iterable[Metric]:
        steady = self._steady
        yield from _build_metrics()
        yield from _plan_metrics(snapshot.plan)
        yield from _actor_metrics(snapshot, self._utc())
        yield from actor_usage(snapshot.statuses, self._heard, steady, self._utc())
        yield from _frame_metrics(snapshot, steady, self._clock())
        yield from _link_metrics(snapshot, steady)
        yield from _queue_metrics(snapshot)
        yield from _verdict_metrics(snapshot)
        yield from map_metrics(snapshot.reducer)
        if snapshot.reducer is not None:
            yield from _result_metrics(snapshot.reducer, steady)


def serve(collector: Collector, port: int, host: str = "127.0.0.1") -> WSGIServer:
    """Serve /metrics; set the collector's snapshot to change what it shows. port 0: any free one.

    Raises InputError for a port or an interface that cannot be had.
    """
    registry = CollectorRegistry()
    registry.register(collector)
    try:
        server, _ = start_http_server(port, addr=host, registry=registry)
    except (OSError, OverflowError) as error:
        found = f"{host}:{port}, which cannot be served ({getattr(error, 'strerror', None) or error})"
        raise InputError("--metrics-port, --metrics-host", found, "a free port, or 0 for any") from None
    return server


def _plan_metrics(plan: Plan) -> Iterable[Metric]:
    yield GaugeMetricFamily(
        "searchlight_plan_objective", "Objective of the running plan", value=plan.objective or 0.0
    )
    yield GaugeMetricFamily("searchlight_plan_gap", "Relative gap to the proven bound", value=plan.gap or 0.0)
    yield GaugeMetricFamily("searchlight_plan_solve_seconds", "Time that planning took", value=plan.solve_s)
    yield GaugeMetricFamily(
        "searchlight_plan_substreams", "Substreams in the running plan", value=len(plan.assignments)
    )


def _build_metrics() -> Iterable[Metric]:
    about = InfoMetricFamily("searchlight_build", "Which program this is")
    about.add_metric([], {"version": version("searchlight"), "python": platform.python_version()})
    yield about


def _actor_metrics(snapshot: Snapshot, utc_s: float) -> Iterable[Metric]:
    """Who has been heard of: a process that is replaced has another start."""
    known = [(name, status.pid) for name, status in snapshot.statuses.items()]
    heard = GaugeMetricFamily(
        "searchlight_snapshot_timestamp_seconds", "When the supervisor last heard, since 1970", value=utc_s
    )
    processes = GaugeMetricFamily(
        "searchlight_actor_process", "Process of an actor; another number is another life", labels=["actor"]
    )
    for name, pid in known:
        processes.add_metric([name], pid)
    losses = CounterMetricFamily("searchlight_actor_losses", "How often an actor was lost", labels=["actor"])
    for name in sorted({name for name, _ in known} | set(snapshot.losses)):
        losses.add_metric([name], snapshot.losses.get(name, 0))
    yield from (heard, processes, losses)


def _queue_metrics(snapshot: Snapshot) -> Iterable[Metric]:
    waiting = GaugeMetricFamily(
        "searchlight_machine_waiting",
        "Packets that wait for a detector",
        labels=["machine", "stream", "detector"],
    )
    for name, machine in snapshot.machines.items():
        for (stream, detector), count in machine.waiting.items():
            waiting.add_metric([name, stream, detector], count)
    yield waiting


def _frame_metrics(snapshot: Snapshot, steady: SteadyCounts, now_s: float) -> Iterable[Metric]:
    captured = CounterMetricFamily(
        "searchlight_frames_captured", "Frames of the video so far", labels=["stream"]
    )
    frames = CounterMetricFamily(
        "searchlight_frames",
        "Frames of the video so far, by what became of them",
        labels=["stream", "outcome"],
    )
    epoch = GaugeMetricFamily(
        "searchlight_stream_epoch",
        "Number of the plan that a stream follows (in real time)",
        labels=["stream"],
    )
    flight = GaugeMetricFamily(
        "searchlight_frames_in_flight", "Frames sent and not yet answered", labels=["stream"]
    )
    contradiction = GaugeMetricFamily(
        "searchlight_frames_contradiction",
        "Frames that the reducer has answered beyond those that the source has sent; 0 unless one of them is wrong",
        labels=["stream"],
    )
    for stream, source in snapshot.sources.items():
        outcomes = _steady_outcomes(frame_outcomes(source, snapshot.reducer), source, steady, now_s)
        done = steady.of(("captured", stream), max(source.frames_done, source.sampled))
        captured.add_metric([stream], done)
        epoch.add_metric([stream], source.epoch)
        contradiction.add_metric([stream], max(0.0, sum(outcomes.values()) - done))
        flight.add_metric([stream], max(0.0, done - sum(outcomes.values())))
        for outcome, count in outcomes.items():
            frames.add_metric([stream, outcome], count)
    yield captured
    yield epoch
    yield frames
    yield flight
    yield contradiction


def _steady_outcomes(
    outcomes: Mapping[str, int], source: SourceStatus, steady: SteadyCounts, now_s: float
) -> dict[str, float]:
    """Only what is final, so that no count falls: one detector drops a frame, and another looks at it a moment later.

    A new process of a source counts what the one before it has sent as its own loss, until the reducer's word on it.
    """
    flying = {"in_flight", "contradiction"}
    final = {"processed", "not_sampled"}
    return {
        outcome: steady.of((source.stream, outcome), count)
        if outcome in final
        else steady.settled((source.stream, outcome), count, now_s)
        for outcome, count in _without_heard(outcomes).items()
        if outcome not in flying
    }


def _without_heard(outcomes: Mapping[str, int]) -> dict[str, int]:
    counts = dict(outcomes)
    if counts.get("source_late"):
        counts["source_late"] = max(0, counts["source_late"] - counts["contradiction"])
    return counts


def frame_outcomes(source: SourceStatus, reducer: ReducerStatus | None) -> dict[str, int]:
    """Frames of a stream so far by outcome: the source's counts and the reducer's.

    captured = all outcomes - contradiction, at every moment: the reducer is asked before the source, so what it has
    answered, the source has sent. If not, one of them is wrong, and by how much is the contradiction.
    """
    done = max(source.frames_done, source.sampled)
    outcomes = Counter({"not_sampled": done - source.sampled, **source.frames_dropped})
    if reducer is not None:
        outcomes["processed"] = reducer.frames.get(source.stream, 0)
        outcomes.update(reducer.frames_dropped.get(source.stream, {}))
    in_flight = done - sum(outcomes.values())
    outcomes["in_flight"], outcomes["contradiction"] = max(0, in_flight), max(0, -in_flight)
    return dict(outcomes)


def _link_metrics(snapshot: Snapshot, steady: SteadyCounts) -> Iterable[Metric]:
    sent = CounterMetricFamily("searchlight_link_bytes", "Bytes sent over a link", labels=["stream", "site"])
    limit = GaugeMetricFamily(
        "searchlight_link_bandwidth_bps", "Bandwidth of a link", labels=["stream", "site"]
    )
    for stream, source in snapshot.sources.items():
        for site, count in source.bytes_sent.items():
            sent.add_metric([stream, site], steady.of(("bytes", stream, site), count, source.pid))
    for (stream, site), bps in snapshot.bandwidth_bps.items():
        limit.add_metric([stream, site], bps)
    yield sent
    yield limit
    yield from _measured_links(snapshot, steady)


def _measured_links(snapshot: Snapshot, steady: SteadyCounts) -> Iterable[Metric]:
    """What the senders know of their links, and what was refused at the doors."""
    labels = ["stream", "site"]
    rate = GaugeMetricFamily("searchlight_link_rate_bps", "What a link lets through, measured", labels=labels)
    backlog = GaugeMetricFamily(
        "searchlight_link_backlog_seconds", "Link time of what is not known to be read", labels=labels
    )
    lost = CounterMetricFamily(
        "searchlight_link_messages_lost",
        "Messages whose connection broke before they were read",
        labels=labels,
    )
    down = GaugeMetricFamily(
        "searchlight_link_down", "Connections of a link that are broken or silent", labels=labels
    )
    for stream, source in snapshot.sources.items():
        for site, link in source.links.items():
            rate.add_metric([stream, site], link.rate_bps)
            backlog.add_metric([stream, site], link.backlog_s)
            lost.add_metric([stream, site], steady.of(("lost", stream, site), link.lost, source.pid))
            down.add_metric([stream, site], len(link.down))
    yield from (rate, backlog, lost, down)
    yield from _refusals(snapshot, steady)


def _refusals(snapshot: Snapshot, steady: SteadyCounts) -> Iterable[Metric]:
    """What the channels did not take; each reason is one of few words."""
    rejected = CounterMetricFamily(
        "searchlight_connections_rejected",
        "Connections that were not taken or were ended: of strangers, of another version, or with bytes of nobody",
        labels=["actor", "reason"],
    )
    refused = CounterMetricFamily(
        "searchlight_messages_refused",
        "Messages of a known actor that were not taken, such as of a stream that is not its own",
        labels=["actor", "reason"],
    )
    said: dict[str, MachineStatus | ReducerStatus] = dict(snapshot.machines)
    if snapshot.reducer is not None:
        said["reducer"] = snapshot.reducer
    for name, status in said.items():
        for family, counts, reasons in (
            (rejected, status.rejected, REJECTED),
            (refused, status.refused, REFUSED),
        ):
            for (
                reason
            ) in reasons:  # also what never happened: a count that appears late cannot be seen to rise
                count = steady.of((family.name, name, reason), counts.get(reason, 0), status.pid)
                family.add_metric([name, reason], count)
    yield from (rejected, refused)


def _verdict_metrics(snapshot: Snapshot) -> Iterable[Metric]:
    """What the verdict of the run would be, were it to end now."""
    reducer = snapshot.reducer
    not_taken = {} if reducer is None else reducer.not_taken
    boxes = 0 if reducer is None else sum(reducer.detections.values())
    doubts = doubts_of(not_taken, boxes, snapshot.findings)
    yield GaugeMetricFamily(
        "searchlight_verdict_cannot_be_trusted",
        "1 if there is a reason not to trust the map, else 0",
        value=float(bool(doubts)),
    )
    reasons = GaugeMetricFamily(
        "searchlight_verdict_doubts",
        "Reasons not to trust the map: boxes refused for one of them, or findings of the checks",
        labels=["reason"],
    )
    for code, count in sorted(doubts.items()):
        reasons.add_metric([code], count)
    yield reasons


def _result_metrics(reducer: ReducerStatus, steady: SteadyCounts) -> Iterable[Metric]:
    results = CounterMetricFamily(
        "searchlight_results", "Results applied to the map", labels=["stream", "detector"]
    )
    for (stream, detector), count in reducer.results.items():
        results.add_metric([stream, detector], steady.of(("results", stream, detector), count))
    dropped = CounterMetricFamily(
        "searchlight_results_dropped",
        "Frames of a substream without a result",
        labels=["stream", "detector", "reason"],
    )
    for (stream, detector), reasons in reducer.dropped.items():
        for reason, count in reasons.items():
            dropped.add_metric(
                [stream, detector, reason], steady.of(("dropped", stream, detector, reason), count)
            )
    not_taken = CounterMetricFamily(
        "searchlight_evidence_not_taken", "Evidence that the map did not take", labels=["reason"]
    )
    for reason, count in reducer.not_taken.items():
        not_taken.add_metric([reason], steady.of(("not taken", reason), count))
    latency = HistogramMetricFamily(
        "searchlight_hop_seconds",
        "Time a result spent on each part of its way",
        labels=["stream", "detector", "hop"],
    )
    for (stream, detector), hops in reducer.hops.items():
        for hop, histogram in hops.items():
            total, buckets = 0.0, list[tuple[str, float]]()
            for bound, count in zip([*map(str, LATENCY_BUCKETS_S), "+Inf"], histogram.counts, strict=True):
                total += steady.of((stream, detector, hop, bound), count)
                buckets.append((bound, total))
            latency.add_metric(
                [stream, detector, hop], buckets, steady.of((stream, detector, hop), histogram.sum_s)
            )
    yield results
    yield dropped
    yield not_taken
    yield latency

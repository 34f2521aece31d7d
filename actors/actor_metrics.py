"""Prometheus metrics of actors: whether each is up, what it uses, how far its clock is from ours."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from actors.heard import Heard, Says
from actors.steady_counts import SteadyCounts


class Process(Says, Protocol):
    """A status that names its process."""

    @property
    def pid(self) -> int:
        """On its node."""


def actor_usage(
    statuses: Mapping[str, Process], heard: Heard, steady: SteadyCounts, utc_s: float
) -> Iterable[Metric]:
    """statuses: the newest of each actor, which heard knows. utc_s: now, since 1970."""
    labels = ["actor"]
    up = GaugeMetricFamily("searchlight_actor_up", "1 if it was heard within the last 2 s", labels=labels)
    seen = GaugeMetricFamily(
        "searchlight_actor_last_seen_timestamp_seconds", "When it was heard last, since 1970", labels=labels
    )
    memory = GaugeMetricFamily(
        "searchlight_actor_memory_bytes", "Resident memory of its process", labels=labels
    )
    used = CounterMetricFamily(
        "searchlight_actor_cpu_seconds", "Processor time of its processes, one after the other", labels=labels
    )
    behind = GaugeMetricFamily(
        "searchlight_actor_clock_behind_seconds",
        "By how much the clock of its node seems behind the ground station's; too much by the quickest word's way",
        labels=labels,
    )
    for name, at_s in heard.last_s().items():
        up.add_metric([name], float(heard.is_up(name, utc_s)))
        seen.add_metric([name], at_s)
    for name, status in statuses.items():
        memory.add_metric([name], status.usage.memory_bytes)
        used.add_metric([name], steady.of(("cpu", name), status.usage.cpu_s, status.pid))
    for name, seconds in heard.clock_behind_s().items():
        behind.add_metric([name], seconds)
    yield from (up, seen, memory, used, behind)

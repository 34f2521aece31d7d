"""Prometheus metrics of one node: whether it has room, and what runs on it, whether a mission flies or not."""

from __future__ import annotations

import os
import platform
import re
import time
from collections import defaultdict
from collections.abc import Iterable, Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.registry import Collector

from actors.usage import resident_bytes

#: how Ray names the processes of our actors in the list of processes
_ACTOR = re.compile(r"^ray::(Source|Machine|Reducer|Scheduler)Actor")
_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


class NodeCollector(Collector):
    """sites: that the node plays. proc: the system's own folder of processes."""

    def __init__(self, sites: Sequence[str], proc: Path = Path("/proc")) -> None:
        self._sites, self._proc = tuple(sites), proc

    def collect(self) -> Iterable[Metric]:
        """All metrics of the node; their names begin with searchlight_node_."""
        about = InfoMetricFamily(
            "searchlight_node", "Which program this node runs, and the sites that it plays"
        )
        sites = " ".join(self._sites)
        about.add_metric(
            [], {"version": version("searchlight"), "python": platform.python_version(), "sites": sites}
        )
        yield about
        clock = GaugeMetricFamily("searchlight_node_clock_timestamp_seconds", "The node's clock, since 1970")
        clock.add_metric([], time.time())
        yield clock
        yield from self._memory()
        yield self._processor()
        yield from self._actors()

    def _memory(self) -> Iterable[Metric]:
        lines = (self._proc / "meminfo").read_text(encoding="ascii").splitlines()
        kib = {name: int(value.split()[0]) for name, _, value in (line.partition(":") for line in lines)}
        for key, name in (("MemTotal", "total"), ("MemAvailable", "available")):
            text = f"Memory of the node, {name}"
            yield GaugeMetricFamily(f"searchlight_node_memory_{name}_bytes", text, value=kib[key] * 1024.0)

    def _processor(self) -> Metric:
        words = (self._proc / "stat").read_text(encoding="ascii").split("\n", 1)[0].split()[1:]
        user, nice, system, idle, wait = (int(word) * _TICK_S for word in words[:5])
        used = CounterMetricFamily(
            "searchlight_node_cpu_seconds", "Of all processors of the node", labels=["mode"]
        )
        for mode, seconds in (("busy", user + nice + system), ("idle", idle + wait)):
            used.add_metric([mode], seconds)
        return used

    def _actors(self) -> Iterable[Metric]:
        """By kind: names of actors are the mission's, and a node does not know them."""
        counts: dict[str, int] = defaultdict(int)
        memory: dict[str, int] = defaultdict(int)
        for folder in self._proc.glob("[0-9]*"):
            with suppress(OSError):  # it has ended meanwhile
                found = _ACTOR.match((folder / "cmdline").read_bytes().decode("utf-8", "replace"))
                if found is not None:
                    kind = found[1].lower()
                    memory[kind] += resident_bytes(folder.name)
                    counts[kind] += 1
        number = GaugeMetricFamily(
            "searchlight_node_actors", "Processes of actors on the node", labels=["kind"]
        )
        resident = GaugeMetricFamily(
            "searchlight_node_actor_memory_bytes", "Their resident memory, together", labels=["kind"]
        )
        for kind in ("source", "machine", "reducer", "scheduler"):
            number.add_metric([kind], counts[kind])
            resident.add_metric([kind], memory[kind])
        yield from (number, resident)

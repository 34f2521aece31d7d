"""One run on Ray, from the plan to what it leaves behind."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

from actors.cluster import cluster
from actors.live import LiveWiring
from actors.metrics import RunCollector, serve
from actors.wiring import RunOptions, Wiring
from pipeline.allocation.plan import Plan
from pipeline.logs import Log
from pipeline.mission.local import FinishedRun
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.run_journal import RunJournal
from pipeline.mission.stopping import Stop

_LOG = Log("actors")
#: who has scraped a run gets so long to fetch its last values, seconds
_LAST_SCRAPE_S = 5.0


def run_on_ray(
    prepared: PreparedMission,
    options: RunOptions,
    progress: Callable[[str, int, int], None],
    say: Callable[[str], None],
    begin: Callable[[Plan], RunJournal],
    stop: Stop,
    plan: Plan | None = None,
) -> FinishedRun:
    """Plan and run. progress(stream, frames done, frames in all); say(one line) for each phase.

    A cluster is joined already (``nodes.joined``). begin: the run's journal, once there is a plan. stop: asked all the
    while. plan: of a run that goes on.
    """
    with _metrics(options, say) as collector:
        _LOG.event("ray", address=options.address or "started here", pace=options.pace)
        sites = [site.id for site in prepared.inventory.sites]
        if options.address is None:
            say("starting Ray")
        with (
            cluster(None, sites, stop) if options.address is None else nullcontext(),
            wiring_of(options)(prepared, options, stop) as wiring,
        ):
            if plan is None:
                say("planning")
                plan = wiring.plan()
            said = f"plan: {plan.status}, objective {plan.objective:.4g}"
            say(f"{said}, {len(plan.assignments)} substreams")
            return wiring.run(plan, begin(plan), progress, collector)


def wiring_of(options: RunOptions) -> type[Wiring]:
    """In real time what is lost is replaced; as fast as possible the run is the reference, to the byte."""
    return LiveWiring if options.pace == "realtime" else Wiring


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
        collector.last_scrape(_LAST_SCRAPE_S)
    finally:
        server.shutdown()
        server.server_close()

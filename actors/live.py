"""A run in real time: the mission controller says what everybody does, and what is lost is replaced.

Every actor is asked again and again, each by itself, so that one that is silent holds up no other. What they say goes
to the scheduler, which hosts the controller; what that orders is passed on. Nobody's answer is waited for.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from actors.calls import UnreachableError, get, kill, remote, remote_here
from actors.hosted_controller import HostedController
from actors.live_record import LiveRecord
from actors.machine import MachineActor, machine_params
from actors.metrics import RunCollector, Snapshot
from actors.reducer import ReducerActor
from actors.scheduler import SchedulerActor
from actors.site import sites_here
from actors.source import SourceActor, SourceStatus
from actors.stream_health import StreamHealths
from actors.wiring import LAST_WORD_S, Wiring
from pipeline.allocation.plan import Plan
from pipeline.errors import RunFailedError, SearchlightError, in_one_line
from pipeline.ingest.live.source import LiveSource
from pipeline.link.keys import Endpoint
from pipeline.messages import FloatArray
from pipeline.mission.clocks import pacing_offsets_s
from pipeline.mission.controller.events import Event, Gone
from pipeline.mission.controller.orders import Expect, Finish, Order, Restart, Run, Say, Send
from pipeline.mission.controller.state import REDUCER, machine_actor, source_actor
from pipeline.mission.flown import Flown
from pipeline.mission.ledger import with_heard
from pipeline.mission.live_files import LiveWays
from pipeline.mission.local import FinishedRun, source_params
from pipeline.mission.run_journal import RunJournal
from pipeline.mission.stages.radio_link import RadioParams
from pipeline.mission.stages.source import SourceParams, StreamInput
from pipeline.outputs.live_names import LIVE


@dataclass(frozen=True)
class LiveParams:
    """Seconds. poll_s: between an actor's answer and the next question. round_s: between two rounds of the supervisor.
    scheduler_s: a scheduler that does not answer for so long is started again, which may take it boot_s. first_s: so
    long the first plan may take until all of it is ready. delay_s: the drones begin so long after that. end_s: how long
    a source waits for what is on its way when its stream ends.
    """

    poll_s: float = 0.25
    round_s: float = 0.05
    scheduler_s: float = 1.5
    boot_s: float = 30.0
    first_s: float = 90.0
    delay_s: float = 1.0
    end_s: float = 4.0


@dataclass
class _Peer:
    """One actor. asked: the question that is not answered yet. endpoint: of Ray, where it listens; reached: it, once
    that is known. key: its public one, once that is known; told_key: of Ray, until then.
    """

    handle: Any
    incarnation: int
    asked: Any = None
    due_s: float = 0.0
    endpoint: Any = None
    reached: Endpoint | None = None
    told_key: Any = None
    key: bytes | None = None
    status: Any = None


class LiveWiring(Wiring):
    """Creates the actors of one run in real time, and keeps them going."""

    params = LiveParams()

    def plan(self) -> Plan:
        """The optimal plan, by the scheduler that goes on to host the controller."""
        params = self.params

        def new() -> Any:
            return remote_here(SchedulerActor).remote(self._prepared)

        self._controller = HostedController(new, params.scheduler_s, params.boot_s, params.poll_s)
        return self._controller.plan()

    def _start(self, plan: Plan, journal: RunJournal) -> None:
        self._plan, self._journal = plan, journal
        self._peers: dict[str, _Peer] = {}
        self._all_planned = False
        self._finish_ordered = False
        self._revoked: set[str] = set()
        self._healths, self._ways = StreamHealths(), dict[str, list[FloatArray]]()
        self._live_ways = LiveWays(journal.folder.parent / LIVE, self._prepared)
        self._record = LiveRecord.of(
            self._prepared, journal.folder.parent, time.monotonic(), sites_here(self._prepared.problem.sites)
        )
        self._controller.begin(plan, self._record, time.monotonic())
        self._begin_reducer(0)
        reducer = self._peers[REDUCER]
        reducer.reached = get(reducer.endpoint, "the reducer")
        for machine in self._prepared.problem.machines:
            self._begin_machine(machine.id, machine.site, 0)
        for stream in self._prepared.streams:
            self._begin_source(stream, 0)
        self._until_first_epochs()
        self._start_s = time.time() + self.params.delay_s
        self._started = time.monotonic()
        for stream in self._prepared.streams:
            self._let_go(stream)
        self._tell_clock()

    # --- actors

    def _begin_reducer(self, incarnation: int) -> None:
        handle = remote_here(ReducerActor).remote(self._prepared, self._plan, None, True, self._journal)
        self._reducer = handle
        self._peers[REDUCER] = _Peer(handle, incarnation, endpoint=handle.endpoint.remote())
        if incarnation:
            self._tell_clock()
        self._tell_keys()

    def _begin_machine(self, name: str, site: str, incarnation: int) -> None:
        codec = self._prepared.mission.processing.codec
        handle = remote(MachineActor, site).remote(name, None, codec, machine_params(self._prepared))
        told_key = handle.public_key.remote()
        with_model = {d.id: d for d in self._prepared.pool.detectors if d.model is not None}
        reducer, layers = self._peers[REDUCER].reached, self._prepared.layers
        endpoint = handle.begin.remote(with_model, reducer, layers, incarnation, self._models)
        self._machines[name] = handle
        self._peers[machine_actor(name)] = _Peer(handle, incarnation, endpoint=endpoint, told_key=told_key)
        self._tell_keys()

    def _begin_source(self, stream: StreamInput, incarnation: int) -> None:
        links = {
            site: bps
            for (name, site), bps in self._prepared.problem.link_bps.items()
            if name == stream.stream and bps > 0.0
        }
        if isinstance(stream.source, LiveSource):
            stream = replace(stream, source=stream.source.again(incarnation))
        handle = remote(SourceActor, stream.site).remote(
            stream,
            (),
            links,
            self._source_params(),
            RadioParams(end_s=self.params.end_s),
        )
        self._sources[stream.stream] = handle
        self._peers[source_actor(stream.stream)] = _Peer(
            handle, incarnation, told_key=handle.public_key.remote()
        )
        self._tell_keys()

    def _source_params(self) -> SourceParams:
        processing = self._prepared.mission.processing
        return replace(source_params(self._prepared), keep_bytes=round(processing.keep_unsent or 0))

    def _let_go(self, stream: StreamInput) -> None:
        """Let a source film: from its start, or for a new one from where the drone is by now."""
        self._sources[stream.stream].film.remote(self._filmed_from_s(stream))

    def _filmed_from_s(self, stream: StreamInput) -> float:
        """When the part of the stream that is used begins, UTC, seconds."""
        if stream.is_live:
            return stream.start_ns * 1e-9
        streams = self._prepared.streams
        offsets_s = pacing_offsets_s(
            [s.start_ns for s in streams], [s.end_s - s.video.start_s for s in streams]
        )
        offset_s = dict(zip((s.stream for s in streams), offsets_s, strict=True))[stream.stream]
        return self._start_s + offset_s

    def _tell_clock(self) -> None:
        """Tell the reducer what is now: no frame can be newer."""
        now_s = time.time()
        films = {
            s.stream: s.start_ns + round((now_s - self._filmed_from_s(s) + s.video.start_s) * 1e9)
            for s in self._prepared.streams
        }
        self._reducer.clock_runs.remote(films)

    # --- what they say

    def _until_first_epochs(self) -> None:
        """Until every stream has its first epoch, or is known to have none."""
        until_s = time.monotonic() + self.params.first_s
        while self._stop.reason is None:
            self._round()
            if self._all_planned:
                return
            if time.monotonic() > until_s:
                raise RunFailedError(f"no stream could be looked at within {self.params.first_s:g} s")

    def _supervise(self, progress: Callable[[str, int, int], None], collector: RunCollector) -> None:
        """Until the streams have ended, or somebody asks to stop."""
        while self._stop.reason is None and not self._finish_ordered:
            before = self._snapshot
            self._round()
            self._snapshot = self._newest(before)
            self._log_ends(before, self._snapshot)
            collector.snapshot = self._snapshot
            self._live_status()
            for source in self._snapshot.sources.values():
                progress(source.stream, source.frames_done, source.frames_total)

    def _live_status(self) -> None:
        assert self._live is not None
        record = self._record
        self._live.write_if_due(
            self._snapshot,
            time.monotonic(),
            timeline=record.timeline,
            assignments=tuple(record.ran.values()),
            lost=[actor for actor, peer in self._peers.items() if peer.due_s == float("inf")],
        )
        self._live_ways.write_if_due(lambda: Flown(self._ways_so_far(), self._reached_s()), time.monotonic())

    def _newest(self, before: Snapshot) -> Snapshot:
        def of(kind: str, names: Any) -> dict[str, Any]:
            said = {name: self._peers[f"{kind}:{name}"].status for name in names}
            return {name: status for name, status in said.items() if status is not None}

        return replace(
            before,
            sources={**before.sources, **of("source", self._sources)},
            machines={**before.machines, **of("machine", self._machines)},
            reducer=self._peers[REDUCER].status or before.reducer,
            losses=self._record.losses,
        )

    def _round(self) -> None:
        """Ask who is due, hear who has answered, and pass on what follows."""
        import ray

        self._learn_keys()
        now = time.monotonic()
        for actor, peer in self._peers.items():
            if peer.asked is None and now >= peer.due_s:
                peer.asked = self._question(actor, peer)
        asked = {peer.asked: actor for actor, peer in self._peers.items() if peer.asked is not None}
        told = [] if self._controller.question is None else [self._controller.question]
        waited = [*asked, *told]
        answered, _ = ray.wait(waited, num_returns=len(waited), timeout=self.params.round_s)
        events = [event for ref in answered if ref in asked for event in self._heard(asked[ref], ref)]
        self._hear(self._controller.question in answered)
        wanted = self._record.asked_by_the_operator()
        if self._revoked != self._record.desk.revoked:
            self._revoked = set(self._record.desk.revoked)
            self._tell_keys()
        self._controller.tell([*events, *wanted], time.monotonic())
        if len(answered) == len(waited):  # else it has waited for the others already
            time.sleep(self.params.round_s)

    def _question(self, actor: str, peer: _Peer) -> Any:
        if actor.startswith("machine:"):
            status = self._peers[REDUCER].status
            return peer.handle.report.remote(() if status is None else status.acknowledged)
        return peer.handle.report.remote(peer.incarnation)

    def _heard(self, actor: str, ref: Any) -> list[Event]:
        """An actor's report, or that it is gone."""
        peer = self._peers[actor]
        peer.asked, peer.due_s = None, time.monotonic() + self.params.poll_s
        try:
            report, peer.status = get(ref, actor)
        except UnreachableError:  # it counts as silent, and is asked again
            return []
        except SearchlightError as error:
            return [self._gone(actor, peer, error)]
        try:
            if peer.reached is None and peer.endpoint is not None:
                peer.reached = get(peer.endpoint, actor, 5.0)
                if actor == REDUCER:
                    self._tell_machines_the_reducer(peer.reached)
        except SearchlightError as error:
            return [self._gone(actor, peer, error)]
        if actor == REDUCER:
            self._record.looked_at(peer.status.frames, time.monotonic())
        if actor.startswith("source:"):
            self._heard_of_a_live_stream(peer.status)
        # what broke on a machine is in its report, substream by substream
        if actor.startswith("machine:") or peer.status.error is None:
            event: Event = report
            return [event]
        return [self._gone(actor, peer, peer.status.error)]

    @staticmethod
    def _gone(actor: str, peer: _Peer, error: SearchlightError) -> Gone:
        peer.due_s = float("inf")
        return Gone(actor, peer.incarnation, in_one_line(error))

    def _heard_of_a_live_stream(self, status: SourceStatus) -> None:
        if status.way is not None:
            self._ways.setdefault(status.stream, []).append(status.way)
        if status.health is not None:
            for said in self._healths.told(status.stream, status.health):
                self._note(said)

    def _tell_machines_the_reducer(self, endpoint: Endpoint | None) -> None:
        for machine in self._machines.values():
            machine.results_to.remote(endpoint)

    def _learn_keys(self) -> None:
        """Of actors that have just been started; whoever is to hear them is told at once, since they call there."""
        import ray

        asked = {p.told_key: (actor, p) for actor, p in self._peers.items() if p.told_key is not None}
        if not asked:
            return
        told, _ = ray.wait(list(asked), num_returns=len(asked), timeout=0.0)
        for ref in told:
            actor, peer = asked[ref]
            peer.told_key = None
            with suppress(SearchlightError):  # it is gone: its report will say so
                peer.key = get(ref, actor)
        if told:
            self._tell_keys()

    def _tell_keys(self) -> None:
        """Tell everybody whom to hear: machines the sources, the reducer the machines. Whoever was replaced is not
        among them any more, nor a drone that the operator has revoked.
        """
        revoked = set(map(source_actor, self._revoked))

        def of(kind: str) -> dict[bytes, str]:
            known = {p.key: a for a, p in self._peers.items() if a.startswith(kind) and p.key is not None}
            return {key: actor for key, actor in known.items() if actor not in revoked}

        self._reducer.accept_only.remote(of("machine:"))
        sources = of("source:")
        for machine in self._machines.values():
            machine.accept_only.remote(sources)

    # --- what the controller wants

    def _hear(self, is_answered: bool) -> None:
        heard, say = self._controller.heard(is_answered, time.monotonic())
        if say is not None:
            self._note(say)
        if heard is None:
            return
        self._all_planned = heard.all_planned
        self._record.take(heard)
        for step in heard.recorded:
            for order in step.orders:
                with suppress(KeyError):  # of an actor that is being replaced: it comes again
                    self._carry_out(order)

    def _carry_out(self, order: Order) -> None:
        match order:
            case Run():
                self._machines[order.machine].run.remote(order)
            case Send():
                machines = {o.machine for o in order.epoch.substreams}
                endpoints = {m: self._peers[machine_actor(m)].reached for m in machines}
                self._sources[order.epoch.stream].follow.remote(order, endpoints)
            case Expect():
                self._reducer.expect.remote(order)
            case Restart():
                self._restart(order)
            case Finish():
                self._finish_ordered = True
            case Say():
                self._note(order)

    def _restart(self, order: Restart) -> None:
        kind, _, name = order.actor.partition(":")
        kill(self._peers[order.actor].handle)
        self._note(Say("started again", order.actor))
        if kind == "machine":
            site = next(m.site for m in self._prepared.problem.machines if m.id == name)
            self._begin_machine(name, site, order.incarnation)
        elif kind == "source":
            stream = next(s for s in self._prepared.streams if s.stream == name)
            self._begin_source(stream, order.incarnation)
            self._let_go(stream)
        else:
            self._begin_reducer(order.incarnation)

    def _note(self, say: Say) -> None:
        if say.what == "up":
            say = replace(say, detail=f"process {self._peers[say.subject].status.pid}")
        self._record.note(say, time.monotonic())

    # --- the end

    def __exit__(self, *_: object) -> None:
        if hasattr(self, "_record"):
            self._record.close()
        if hasattr(self, "_controller"):
            self._controller.end()
        super().__exit__()

    def _result(self, plan: Plan) -> FinishedRun:
        return self._with_record(super()._result(plan))

    def _ended_early(self, plan: Plan, journal: RunJournal, error: SearchlightError | None) -> FinishedRun:
        return self._with_record(super()._ended_early(plan, journal, error))

    def _with_record(self, run: FinishedRun) -> FinishedRun:
        record = self._record
        # what was made ready but never used is not known to the reducer
        ran = tuple(a for key, a in record.ran.items() if key in run.reducer.processed)
        again = {name for name in self._sources if self._peers[source_actor(name)].incarnation > 0}
        counts = {n: with_heard(n, c, run.reducer) if n in again else c for n, c in run.counts.items()}
        return replace(
            run,
            counts=counts,
            ran=ran,
            timeline=tuple(record.timeline),
            search_area=record.area.file,
            flown=Flown(self._ways_to_the_end(), self._reached_s()),
        )

    def _ways_to_the_end(self) -> dict[str, FloatArray]:
        """Of the cameras of live streams; of one whose source is lost, as far as it was heard."""
        for stream in self._prepared.streams:
            if stream.is_live:
                with suppress(SearchlightError):
                    rest = get(self._sources[stream.stream].way.remote(), stream.stream, LAST_WORD_S)
                    self._ways.setdefault(stream.stream, []).append(rest)
        return self._ways_so_far()

    def _ways_so_far(self) -> dict[str, FloatArray]:
        for stream, rows in self._ways.items():
            self._ways[stream] = [np.concatenate(rows)]
        return {stream: rows[0] for stream, rows in self._ways.items()}

    def _reached_s(self) -> dict[str, float]:
        return {stream: source.reached_s for stream, source in self._snapshot.sources.items()}

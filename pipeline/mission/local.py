"""The whole chain in one process, without Ray: the reference that the actors must equal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.allocation.plan import Assignment, Plan
from pipeline.config.fusion import Fusion
from pipeline.detection import open_pool_detector
from pipeline.errors import SearchlightError, failure, in_one_line
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.replay import ReplayParams
from pipeline.fusion.sequencer import Sequencer
from pipeline.ingest.finding import Finding
from pipeline.link.codec import Codec
from pipeline.link.sender import LinkState
from pipeline.logs import Log
from pipeline.messages import Message
from pipeline.mission.durable_reducer import DurableReducer
from pipeline.mission.flown import Flown
from pipeline.mission.live_files import LiveMap, write_local_status
from pipeline.mission.missing import WhatIsMissing
from pipeline.mission.onto import go_on
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.run_journal import RunJournal, journal_findings
from pipeline.mission.stages.detector import DetectorStage
from pipeline.mission.stages.reducer import NO_REPLAY, ReducerStage
from pipeline.mission.stages.source import SourceCount, SourceParams, SourceStage, StreamInput
from pipeline.mission.stages.virtual_link import VirtualLink
from pipeline.mission.stopping import Stop
from pipeline.outputs.live_names import LIVE
from pipeline.outputs.partial import CutOff, Partial
from pipeline.outputs.timeline import TimelineEntry
from pipeline.sensor.substream import SubstreamModel, as_sent, substream_model

_LOG = Log("mission")
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """What a run leaves behind, before it is written.

    plan: what ran. reducer: with the map. counts: of the sources. bytes_sent: per (stream, site). seconds:
    first frame to last result. pace: ``realtime``, ``max``, ``local``, or ``fuse`` for detections that others
    made; own_detections: sentences about these, see Summary. links: measured, per (stream, site), in real
    time. partial: why and where it ended too early, if it did. findings: what was noticed on the way. error: that
    ended it. ran: what else was run than the plan that it began with. timeline: what happened on the way. search_area:
    the file of another one that an operator gave in flight. flown: the ways of live streams.
    """

    plan: Plan
    reducer: ReducerStage
    counts: dict[str, SourceCount]
    bytes_sent: Mapping[tuple[str, str], int]
    seconds: float
    pace: str
    own_detections: tuple[str, ...] = ()
    links: Mapping[tuple[str, str], LinkState] = field(default_factory=dict)
    partial: Partial | None = None
    findings: tuple[Finding, ...] = ()
    error: SearchlightError | None = None
    ran: tuple[Assignment, ...] = ()
    timeline: tuple[TimelineEntry, ...] = ()
    search_area: Path | None = None
    flown: Flown = field(default_factory=Flown)

    @property
    def assignments(self) -> tuple[Assignment, ...]:
        """Of every stream and detector that was ever run."""
        return self.ran or self.plan.assignments


@dataclass(frozen=True)
class Processed:
    """counts: of the sources. bytes_sent: per (stream, site). cut_off: streams that were not sent to their end. error:
    that ended it.
    """

    counts: dict[str, SourceCount]
    bytes_sent: dict[tuple[str, str], int]
    cut_off: tuple[CutOff, ...] = ()
    error: SearchlightError | None = None


def run_local(
    prepared: PreparedMission,
    plan: Plan,
    progress: Progress,
    journal: RunJournal | None = None,
    stop: Stop | None = None,
) -> FinishedRun:
    """Process every stream, one frame of each in turn. progress(stream, frames done, frames in all).

    journal: where what is taken is kept; what it holds already is not looked at again. stop: asked after every round.
    """
    started = time.monotonic()
    _LOG.event("run begins", streams=[s.stream for s in prepared.streams], pace="local")
    reducer, stop = make_reducer(prepared, plan, lateness=False), stop or Stop()
    durable = None if journal is None else journal.reducer(reducer, started)
    live = None if journal is None else LiveMap(journal.folder.parent / LIVE, prepared)

    def push(message: Message) -> None:
        if durable is None:
            reducer.push(message)
        else:
            durable.push(message, time.monotonic())
            durable.tick(time.monotonic())
        if live is not None and live.write_if_due(reducer, time.monotonic()):
            write_local_status(live.folder, prepared, plan, reducer, time.monotonic() - started)

    done = process(prepared, plan, push, progress, stop, durable)
    if done.error is not None:
        if not any(reducer.received.values()):
            raise done.error
        stop.ask(f"failed: {in_one_line(done.error)}")
    (durable or reducer).finish()
    seconds = time.monotonic() - started
    _LOG.event("run ends", seconds=round(seconds, 3))
    partial = None
    if stop.reason is not None and done.cut_off:
        partial = Partial(stop.reason, stop.at_ns, done.cut_off)
    findings = () if durable is None else journal_findings(durable)
    return FinishedRun(
        plan,
        reducer,
        done.counts,
        done.bytes_sent,
        seconds,
        "local",
        partial=partial,
        findings=findings,
        error=done.error,
    )


def process(
    prepared: PreparedMission,
    plan: Plan,
    push: Callable[[Message], None],
    progress: Progress,
    stop: Stop | None = None,
    durable: DurableReducer | None = None,
) -> Processed:
    """Run all but the reducer: push gets its messages. durable: what it holds is not looked at again."""
    stages = make_detectors(prepared, plan)

    def deliver_from(stream: str) -> Callable[[str, Message], None]:
        def deliver(detector: str, message: Message) -> None:
            push(stages[stream, detector].process(message, 0))

        return deliver if durable is None or not durable.recovered else WhatIsMissing(deliver, durable.holds)

    links = {
        s.stream: VirtualLink(bandwidth(prepared, plan, s.stream), deliver_from(s.stream))
        for s in prepared.streams
    }
    sources = {
        s.stream: SourceStage(s, plan.assignments, links[s.stream], source_params(prepared))
        for s in prepared.streams
    }
    reached_s = {s.stream: s.video.start_s for s in prepared.streams}
    running = {s.stream: _step(s, sources[s.stream], progress, reached_s) for s in prepared.streams}
    stop, failed = stop or Stop(), None
    stop.awaited = True
    try:
        while running and stop.reason is None:
            running = {name: steps for name, steps in running.items() if next(steps, None) is not None}
    except Exception as error:
        failed = failure(error)
    counts = {name: source.count for name, source in sources.items()}
    sent = {(name, site): count for name, link in links.items() for site, count in link.bytes_sent.items()}
    cut_off = tuple(cut_off_at(s, reached_s[s.stream]) for s in prepared.streams if s.stream in running)
    return Processed(counts, sent, cut_off, failed)


def cut_off_at(stream: StreamInput, video_s: float) -> CutOff:
    """Of a stream that was sent up to a time of its video."""
    begin_s = stream.video.start_s
    end_s = video_s if stream.is_live else stream.end_s
    return CutOff(stream.stream, video_s - begin_s, end_s - begin_s, stream.trajectory.utc_ns(video_s))


def make_reducer(
    prepared: PreparedMission,
    plan: Plan,
    *,
    lateness: bool,
    relative_accuracy: Mapping[str, float] | None = None,
) -> ReducerStage:
    """The reducer for a plan; without lateness it waits for every substream for as long as it takes. With lateness, in
    real time, it begins without substreams.

    relative_accuracy: of the pool detectors, 0..1, where it does not follow from the pool.
    """
    # in real time substreams are opened by order, those of the first plan too
    substreams = () if lateness else tuple((a.stream, a.detector) for a in plan.assignments)
    by_pool = relative_accuracy or prepared.relative_accuracy
    relative = {a.detector: by_pool[a.pool_detector] for a in plan.assignments}
    worth = None if relative_accuracy else substream_models(prepared, plan)
    fuser = Fuser(prepared.terrain, prepared.mission.fusion, prepared.cameras, relative, substreams=worth)
    if prepared.onto is not None:
        go_on(fuser, prepared.onto, min(s.start_ns for s in prepared.streams))
        _LOG.event("map goes on", run=prepared.onto.path, flights=len(prepared.onto.flights))
    lateness_ns = round(prepared.mission.fusion.lateness * 1e9) if lateness else None
    start_ns = {s.stream: s.start_ns for s in prepared.streams}

    def learn(fuser: Fuser, assignment: Assignment, epoch: int) -> None:
        relative = by_pool[assignment.pool_detector]
        fuser.learn(
            assignment.stream, assignment.detector, epoch, relative, substream_worth(prepared, assignment)
        )

    sequencer = Sequencer(substreams, lateness_ns, start_ns)
    replay = replay_params(prepared.mission.fusion) if lateness else NO_REPLAY
    return ReducerStage(fuser, sequencer, substreams, learn, replay)


def replay_params(fusion: Fusion) -> ReplayParams:
    """Of results that come later than the lateness."""
    return ReplayParams(round(fusion.replay * 1e9), fusion.replay_results)


def substream_models(prepared: PreparedMission, plan: Plan) -> dict[tuple[str, str], SubstreamModel]:
    """What each substream of a plan is worth, at the bitrate and under the codec that it is sent with."""
    return {(a.stream, a.detector): substream_worth(prepared, a) for a in plan.assignments}


def substream_worth(prepared: PreparedMission, assignment: Assignment) -> SubstreamModel:
    """What one substream is worth."""
    pool = {d.id: d for d in prepared.pool.detectors}
    best = max(d.best_accuracy for d in pool.values())
    a = assignment
    return substream_model(pool[a.pool_detector], codec_of(prepared, a), a.bitrate_bps, best, a.setup)


def codec_of(prepared: PreparedMission, assignment: Assignment) -> Codec:
    """The codec of a substream."""
    return assignment.codec or prepared.mission.processing.codec


def source_params(prepared: PreparedMission) -> SourceParams:
    """The limits of the mission's sources."""
    return SourceParams(most_age_s=prepared.mission.processing.max_processing_time)


def make_detectors(prepared: PreparedMission, plan: Plan) -> dict[tuple[str, str], DetectorStage]:
    """One stage, with a decoder of its own, per substream."""
    return {(a.stream, a.detector): make_detector(prepared, a) for a in plan.assignments}


def make_detector(prepared: PreparedMission, assignment: Assignment) -> DetectorStage:
    """The stage of one substream."""
    codec = codec_of(prepared, assignment)
    row = as_sent(prepared.runnable(assignment.pool_detector), codec, assignment.bitrate_bps)
    detector = open_pool_detector(row, prepared.layers, assignment.setup)
    _LOG.event(
        "detector opened", stream=assignment.stream, detector=assignment.detector, setup=assignment.setup
    )
    return DetectorStage(detector, codec)


def bandwidth(prepared: PreparedMission, plan: Plan, stream: str) -> dict[str, float]:
    """Bandwidth of the stream's link to every site that the plan uses for it, bits per second."""
    used = sorted({a.site for a in plan.assignments if a.stream == stream})
    return {site: prepared.problem.link_bps[stream, site] for site in used}


def _step(
    stream: StreamInput, source: SourceStage, progress: Progress, reached_s: dict[str, float]
) -> Iterator[bool]:
    for frame in source.frames():
        reached_s[stream.stream] = frame.time_s
        source.offer(frame, frame.time_s - stream.video.start_s)
        progress(stream.stream, source.count.captured, stream.video.pictures or source.count.captured)
        yield True
    source.end()
    _LOG.event("stream ends", stream=stream.stream, captured=source.count.captured)
    progress(stream.stream, source.count.captured, source.count.captured)

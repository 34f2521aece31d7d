"""What must hold of every rehearsal, whatever went wrong in it. A breach is a line that says what does not hold."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

from pipeline.mission.controller.recorded import replay
from pipeline.mission.controller.state import StreamState, begin
from pipeline.mission.controller.substreams import Substream
from pipeline.mission.rehearsal.rehearse import Rehearsal

#: a loss is noticed within so long
NOTICED_S = 2.0
#: what happens at an actor is known to the controller after so long
HEARD_S = 0.3
#: a switch takes no longer
SWITCH_S = 2.0
#: so long a source may not have heard that a substream is closed
VOID_S = 1.5


@dataclass(frozen=True)
class LawParams:
    """end_s: the mission ends at most so long after its last frame. quiet_s: from then on nothing is wrong any more.

    served: share of the frames from quiet_s on that are looked at, of streams that the plan serves. replayed: whether
    the log is played again, which takes as long as the rehearsal.
    """

    quiet_s: float
    end_s: float = 25.0
    served: float = 0.9
    replayed: bool = True

    @property
    def judged_s(self) -> tuple[float, float]:
        """When the controller's state is looked at: a switch that is under way then is over at the other time."""
        return self.quiet_s, self.quiet_s + SWITCH_S


def breaches(rehearsal: Rehearsal, params: LawParams) -> list[str]:
    """Every law that does not hold of a rehearsal that was played."""
    laws = (
        _ends,
        _fates,
        _causes,
        _safe,
        _final,
        _crashed,
        _looks,
        _ready,
        _memory,
        _noticed,
        _restarts,
        _not_into_the_void,
        _followed,
        _served,
        _replayed,
    )
    return [f"{law.__name__[1:]}: {breach}" for law in laws for breach in law(rehearsal, params)]


def _ends(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """The mission ends."""
    last_s = rehearsal.ticks / rehearsal.problem.frame_rate_hz
    if not rehearsal.is_over:
        yield f"not over {rehearsal.timeline.now - last_s:.1f} s after the last frame"
    elif rehearsal.timeline.now > last_s + params.end_s:
        yield f"over only {rehearsal.timeline.now - last_s:.1f} s after the last frame"


def fates(rehearsal: Rehearsal, stream: str) -> dict[int, str]:
    """What became of each frame of a stream: ``processed``, or why not; ``in flight`` if nobody can say."""
    disk = rehearsal.reducer.disk
    source = rehearsal.sources[stream]
    results: dict[int, dict[Substream, str]] = defaultdict(dict)
    for key, kept in disk.items():
        for result in kept.results.values() if key.stream == stream else ():
            results[result.tick][key] = result.dropped or "processed"
    found: dict[int, str] = {}
    for tick in range(rehearsal.ticks):
        if tick in source.sent:
            of_tick = [results[tick].get(key) or _lost(rehearsal, key) for key in source.sent[tick]]
            found[tick] = "processed" if "processed" in of_tick else of_tick[0]
        else:
            found[tick] = source.dropped.get(tick, "source_lost")
    return found


def _lost(rehearsal: Rehearsal, key: Substream) -> str:
    kept = rehearsal.reducer.disk.get(key)
    return "in flight" if kept is None or kept.closed is None else f"lost: {kept.closed}"


def _fates(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """captured = processed + dropped + in flight, and at the end nothing is in flight or lost without a cause."""
    for stream, source in rehearsal.sources.items():
        counts = Counter(fates(rehearsal, stream).values())
        if set(source.sent) & set(source.dropped):
            yield f"{stream}: frames both sent and dropped"
        for fate in ("in flight", "lost: ended", "lost: not_used"):
            if counts[fate]:
                yield f"{stream}: {counts[fate]} frames {fate}"
        faulted = any(f.target in (source.name, "scheduler") for f in rehearsal.faults)
        if counts["source_lost"] and not faulted:
            yield f"{stream}: {counts['source_lost']} frames lost with a source that was well"


def _causes(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """No frame is lost behind a source whose own machine, link and process were well."""
    hit = {fault.target for fault in rehearsal.faults}
    site_of = {d.id: (d.machine, d.site) for d in rehearsal.problem.detectors}
    for key, kept in rehearsal.reducer.disk.items():
        machine, site = site_of[key.detector]
        if hit & {f"machine:{machine}", f"source:{key.stream}", f"{key.stream}>{site}"}:
            continue
        sent = sum(key in keys for keys in rehearsal.sources[key.stream].sent.values())
        if len(kept.results) < sent:
            yield f"{key}: {sent - len(kept.results)} of {sent} frames lost, {kept.closed}, though nothing was wrong"


def _final(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """What was counted as lost when a substream was closed is never taken afterwards."""
    for key, kept in rehearsal.reducer.disk.items():
        if kept.closed is not None and kept.counted != len(kept.results):
            yield f"{key}: {len(kept.results)} results, {kept.counted} when it was closed"


def _safe(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """What was acknowledged is on the disk."""
    for key, sequences in rehearsal.noted.acknowledged.items():
        kept = rehearsal.reducer.disk[key]
        missing = {s for s in sequences if s not in kept.results and s != kept.ends}
        if missing:
            yield f"{key}: {len(missing)} acknowledged messages are not on the disk"


def _looks(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """A frame is looked at by at most detPerFrame detectors, and by each at most once."""
    most = rehearsal.problem.detectors_per_frame
    looks: Counter[tuple[str, int]] = Counter()
    by_detector: Counter[tuple[str, str, int]] = Counter()
    for key, kept in rehearsal.reducer.disk.items():
        for result in kept.results.values():
            if result.dropped is None:
                looks[key.stream, result.tick] += 1
                by_detector[key.stream, key.detector, result.tick] += 1
    yield from (f"{stream} frame {tick}: {n} looks" for (stream, tick), n in looks.items() if n > most)
    yield from (
        f"{stream} frame {tick}: {d} looked {n} times"
        for (stream, d, tick), n in by_detector.items()
        if n > 1
    )


def _ready(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """No packet comes before its detector is warm."""
    yield from (
        f"{m.name}: {m.too_early} packets too early" for m in rehearsal.machines.values() if m.too_early
    )


def _memory(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """No machine ever holds more than it has memory for."""
    for limit in rehearsal.problem.machines:
        held = rehearsal.machines[limit.id].most_bytes
        if held > limit.memory_bytes * (1.0 + 1e-9):
            yield f"{limit.id}: held {held:g} of {limit.memory_bytes:g} bytes"


def _noticed(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """Whoever was killed or stopped while up is said to be lost in time, as long as the scheduler was well."""
    blind = [f.at_s for f in rehearsal.faults if f.target == "scheduler"]
    lost = [(at_s, say.subject) for at_s, say in rehearsal.noted.said if say.what == "lost"]
    for fault in rehearsal.noted.struck:
        if fault.kind == "stop" and fault.duration_s < NOTICED_S:
            continue
        if any(-8.0 < at_s - fault.at_s < NOTICED_S for at_s in blind):
            continue
        if not any(
            0.0 <= at_s - fault.at_s <= NOTICED_S for at_s, subject in lost if subject == fault.target
        ):
            yield f"{fault} was not noticed"


def _crashed(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """A substream whose detector broke says so; with a scheduler that was away, another reason may come first.

    So it may with one that is being closed at that very moment.
    """
    if any(f.target == "scheduler" for f in rehearsal.faults):
        return
    for crashed_s, key in rehearsal.noted.crashed:
        kept = rehearsal.reducer.disk.get(key)
        if kept is not None and kept.closed is not None and kept.closed_s - crashed_s < HEARD_S:
            continue
        if kept is not None and kept.closed not in ("detector_failed", "machine_lost", "ended", "not_used"):
            yield f"{key}: its detector crashed, it was closed as {kept.closed}"


def _restarts(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """No process is replaced without a cause."""
    causes = Counter(f.target for f in rehearsal.faults if f.kind in ("kill", "stop"))
    for actor, count in Counter(actor for _, actor in rehearsal.noted.restarts).items():
        for_good = any(f.kind == "kill" and f.target == actor for f in rehearsal.faults)
        if count > causes[actor] and not (actor.startswith("machine:") and for_good):
            yield f"{actor}: started again {count} times, {causes[actor]} faults"


def _not_into_the_void(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """Nobody sends for long into a substream that is closed, as long as scheduler and source are well."""
    for stream, source in rehearsal.sources.items():
        blind = [f.at_s for f in rehearsal.faults if f.target in ("scheduler", source.name)]
        for tick, keys in source.sent.items():
            for closed_s in (rehearsal.reducer.disk[k].closed_s for k in keys if k in rehearsal.reducer.disk):
                late_s = tick / rehearsal.problem.frame_rate_hz - closed_s
                if late_s > VOID_S and not any(-8.0 < at_s - closed_s < late_s for at_s in blind):
                    yield f"{stream} frame {tick}: sent into what was closed at {closed_s:.1f} s"


def _followed(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """When all is well again, every source follows what the plan wants, but for the time of a switch."""
    noted = rehearsal.noted.states
    states = [noted[at_s] for at_s in params.judged_s if at_s in noted]
    if len(states) < len(params.judged_s):  # it was over before
        return
    followed = {name for state in states for name, stream in state.streams.items() if _follows(stream)}
    for name, stream in states[-1].streams.items():
        if name not in followed:
            standing = stream.standing.substreams if stream.standing else ()
            yield f"{name}: follows {standing}, wanted is {stream.wanted}"


def _follows(stream: StreamState) -> bool:
    standing = stream.standing.substreams if stream.standing else ()
    return stream.ended or (standing == stream.wanted and len(stream.given) <= 1)


def _served(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """When all is well again, what the plan of that moment serves is looked at."""
    state = rehearsal.noted.states.get(params.quiet_s, rehearsal.scheduler.state)
    rate_hz, ticks = rehearsal.problem.frame_rate_hz, rehearsal.ticks
    first, last = round(params.quiet_s * rate_hz), ticks - round(rate_hz)
    for name, stream in state.streams.items():
        if stream.unserved is not None or stream.source.life == "lost":
            continue
        of_stream = fates(rehearsal, name)
        seen = sum(of_stream[tick] == "processed" for tick in range(first, last))
        if seen < params.served * (last - first):
            rest = Counter(of_stream[tick] for tick in range(first, last))
            yield f"{name}: {seen} of {last - first} frames looked at when all was well: {dict(rest)}"


def _replayed(rehearsal: Rehearsal, params: LawParams) -> Iterator[str]:
    """The log, played again, gives the same orders and the same state."""
    scheduler = rehearsal.scheduler
    if not params.replayed:
        return
    try:
        state = replay(
            begin(rehearsal.problem, 0.0, scheduler.state.params, scheduler.state.here), scheduler.log
        )
    except ValueError as error:
        yield str(error)
        return
    if scheduler.alive and state != scheduler.state:
        yield "another state"

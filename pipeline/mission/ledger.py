"""What became of every frame, once a run is over: the sources' counts and the reducer's put together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from pipeline.allocation.plan import Assignment
from pipeline.ingest.finding import Finding
from pipeline.mission.stages.latency import HopHistogram
from pipeline.mission.stages.reducer import ReducerStage
from pipeline.mission.stages.source import LINK_LOST, SourceCount
from pipeline.outputs.accounting import StreamAccount
from pipeline.outputs.summary import Latency, SubstreamCount

#: what became of a frame whose end nobody knows: where it was seen last
_AFTER_SOURCE = "lost_last_seen_at_source"
_AT_REDUCER = "not_applied_last_seen_at_reducer"


def stream_account(stream: str, count: SourceCount, reducer: ReducerStage) -> StreamAccount:
    """Every frame of the video once: processed, or dropped with a reason."""
    processed = reducer.frames(stream) & count.due.keys()
    dropped = Counter(
        _reason(index, due, stream, count, reducer)
        for index, due in count.due.items()
        if index not in processed
    )
    dropped.update(count.lost.values())
    dropped["not_sampled"] += count.not_sampled
    return StreamAccount(stream, count.captured, len(processed), {k: n for k, n in dropped.items() if n})


def count_known_to(stream: str, reducer: ReducerStage) -> SourceCount:
    """Of a source that is gone: the frames of it that the reducer has heard of."""
    due: dict[int, tuple[str, ...]] = {}
    for name, detector in reducer.received:
        if name == stream:
            for index in sorted(reducer.received[name, detector] | reducer.dropped[name, detector].keys()):
                due[index] = (*due.get(index, ()), detector)
    return SourceCount(captured=len(due), due=due)


def with_heard(stream: str, count: SourceCount, reducer: ReducerStage) -> SourceCount:
    """The count of a source that was started again, and knows nothing of what the one before it has sent.

    Of a recording it comes by every frame again; of a live stream what the one before it captured, and nobody heard of,
    is known to nobody.
    """
    due, dropped, captured = dict(count.due), dict(count.dropped), count.captured
    for name, detector in sorted(reducer.received):
        if name != stream:
            continue
        for index in reducer.received[name, detector] | reducer.dropped[name, detector].keys():
            dropped.pop((index, detector), None)
            captured += index not in due
            if detector not in due.get(index, ()):
                due[index] = (*due.get(index, ()), detector)
    return replace(count, due=due, dropped=dropped, captured=captured)


def substream_counts(
    assignments: Sequence[Assignment], counts: dict[str, SourceCount], reducer: ReducerStage
) -> list[SubstreamCount]:
    """Every frame that was a detector's turn: processed, or dropped with a reason."""
    return [
        _substream(a.stream, a.detector, a.machine, a.site, counts[a.stream], reducer) for a in assignments
    ]


def _substream(
    stream: str, detector: str, machine: str, site: str, count: SourceCount, reducer: ReducerStage
) -> SubstreamCount:
    offered = [index for index, due in count.due.items() if detector in due]
    processed = reducer.processed[stream, detector].intersection(offered)
    dropped = Counter(
        _fate(index, stream, detector, count, reducer) for index in offered if index not in processed
    )
    return SubstreamCount(
        stream,
        detector,
        machine,
        site,
        len(offered),
        len(processed),
        dict(dropped),
        reducer.detections[stream, detector],
        _latencies(reducer.hops[stream, detector]),
    )


def _reason(index: int, due: tuple[str, ...], stream: str, count: SourceCount, reducer: ReducerStage) -> str:
    """One reason for the frame as a whole: the first detector's, in the plan's order."""
    return next((_fate(index, stream, d, count, reducer) for d in due), "not_assigned")


def _fate(index: int, stream: str, detector: str, count: SourceCount, reducer: ReducerStage) -> str:
    if (index, detector) in count.dropped:
        return count.dropped[index, detector]
    if index in reducer.dropped[stream, detector]:
        return reducer.dropped[stream, detector][index]
    if index in reducer.received[stream, detector]:
        return _AT_REDUCER
    return reducer.closed.get((stream, detector), _AFTER_SOURCE)


def contradictions(stream: str, count: SourceCount, reducer: ReducerStage) -> list[Finding]:
    """Where the two ends do not agree: the source counts what it sent, the reducer what it was sent.

    A frame whose connection broke may have arrived: the source says so, and the reducer knows.
    """
    found = []
    for (name, detector), frames in sorted(reducer.received.items()):
        if name != stream:
            continue
        heard = frames | reducer.dropped[name, detector].keys()
        never = [i for i in heard if detector not in count.due.get(i, ())]
        not_sent = [i for i in heard if count.dropped.get((i, detector), LINK_LOST) != LINK_LOST]
        for what, indices in (("was never to be sent", never), ("the source did not send", not_sent)):
            if indices:
                text = f"{len(indices)} frames came from {detector} that {what}, the first is number {min(indices)}"
                found.append(Finding("warning", "ledger_contradiction", f"stream {stream}", text))
    return found


def _latencies(hops: Mapping[str, HopHistogram]) -> dict[str, Latency]:
    found = {}
    for hop, histogram in hops.items():
        mean_s, median_s, p99_s = histogram.mean_s, histogram.at_most_s(0.5), histogram.at_most_s(0.99)
        if mean_s is not None and median_s is not None and p99_s is not None:
            found[hop] = Latency(mean_s, median_s, p99_s)
    return found

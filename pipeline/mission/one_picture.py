"""One picture of each stream on its whole planned way: decoded, encoded, sent, decoded, looked at, laid into a map."""

from __future__ import annotations

from dataclasses import replace

from pipeline.allocation.plan import Assignment, Plan
from pipeline.ingest.finding import Finding
from pipeline.messages import Frame, Message
from pipeline.mission.local import bandwidth, make_detector, make_reducer
from pipeline.mission.memory import give_back
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.stages.reducer import ReducerStage
from pipeline.mission.stages.source import SourceStage, StreamInput
from pipeline.mission.stages.virtual_link import VirtualLink

#: where the first pictures are damaged, so many are tried
_TRIED = 5


def push_one_picture(prepared: PreparedMission, plan: Plan) -> list[Finding]:
    """A warning for each substream on whose way the picture was lost. The map is thrown away.

    Raises what a run would raise at its start, such as InputError for a model that cannot be opened.
    """
    reducer = make_reducer(prepared, plan, lateness=False)
    findings = []
    for stream in prepared.streams:
        give_back()
        frame = _first_frame(stream)
        if frame is None:
            text = f"none of the first {_TRIED} pictures with a pose can be decoded"
            findings.append(Finding("warning", "no_picture", str(stream.path), text))
        # one after the other: all detectors of a plan together need a drone's memory each
        for assignment in (a for a in plan.assignments if a.stream == stream.stream):
            _push(prepared, plan, stream, assignment, frame, reducer)
    reducer.finish()
    for (name, detector), seen in sorted(reducer.processed.items()):
        reasons = set(reducer.dropped[name, detector].values())
        if not seen and reasons:
            text = f"a picture did not get through {detector}: {', '.join(sorted(reasons))}"
            findings.append(Finding("warning", "picture_lost", f"stream {name}", text))
    return findings


def _push(
    prepared: PreparedMission,
    plan: Plan,
    stream: StreamInput,
    assignment: Assignment,
    frame: Frame | None,
    reducer: ReducerStage,
) -> None:
    """A frame, if there is one, through the substream of an assignment, which is due at once, to its end."""
    stage = make_detector(prepared, assignment)

    def deliver(_: str, message: Message) -> None:
        reducer.push(stage.process(message, 0))

    due = replace(assignment, period=1, phase=0, bitrate_bps=assignment.bitrate_bps / assignment.period)
    link = VirtualLink(bandwidth(prepared, plan, stream.stream), deliver)
    source = SourceStage(stream, (due,), link)
    if frame is not None:
        source.offer(frame, 0.0)
    source.end()


def _first_frame(stream: StreamInput) -> Frame | None:
    """The first picture that has a pose and is not damaged, as it is sent."""
    times_s = stream.source.times_s
    covered = times_s[stream.trajectory.covers(times_s)][:_TRIED].tolist()
    for time_s, planes in stream.source.planes_at(covered):
        pose = stream.trajectory.pose(time_s)
        if pose is not None:
            return Frame(stream.stream, 0, 0, time_s, stream.trajectory.utc_ns(time_s), pose, planes)
    return None

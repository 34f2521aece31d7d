"""One picture of each stream on its whole planned way: decoded, encoded, sent, decoded, looked at, laid into a map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from av.video.frame import VideoFrame

from pipeline.allocation.plan import Plan
from pipeline.ingest.finding import Finding
from pipeline.messages import Frame, Message
from pipeline.mission.local import MAX_BACKLOG_S, bandwidth, make_detectors, make_reducer
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.stages.source import SourceStage, StreamInput
from pipeline.mission.stages.virtual_link import VirtualLink

#: where the first pictures are damaged, so many are tried
_TRIED = 5


def push_one_picture(prepared: PreparedMission, plan: Plan) -> list[Finding]:
    """A warning for each substream on whose way the picture was lost. The map is thrown away.

    Raises what a run would raise at its start, such as InputError for a model that cannot be opened.
    """
    reducer = make_reducer(prepared, plan, lateness=False)
    stages = make_detectors(prepared, plan)
    # every detector is due at once
    at_once = tuple(
        replace(a, period=1, phase=0, bitrate_bps=a.bitrate_bps / a.period) for a in plan.assignments
    )

    def deliver_from(stream: str) -> Callable[[str, Message], None]:
        return lambda detector, message: reducer.push(stages[stream, detector].process(message, 0))

    findings = []
    for stream in prepared.streams:
        link = VirtualLink(bandwidth(prepared, plan, stream.stream), deliver_from(stream.stream))
        source = SourceStage(stream, at_once, link, MAX_BACKLOG_S)
        frame = _first_frame(stream)
        if frame is None:
            text = f"none of the first {_TRIED} pictures with a pose can be decoded"
            findings.append(Finding("warning", "no_picture", str(stream.path), text))
        else:
            source.offer(frame, 0.0)
        source.end()
    reducer.finish()
    for (name, detector), seen in sorted(reducer.processed.items()):
        reasons = set(reducer.dropped[name, detector].values())
        if not seen and reasons:
            text = f"a picture did not get through {detector}: {', '.join(sorted(reasons))}"
            findings.append(Finding("warning", "picture_lost", f"stream {name}", text))
    return findings


def _first_frame(stream: StreamInput) -> Frame | None:
    """The first picture that has a pose and is not damaged, as it is sent."""
    times_s = stream.source.times_s
    covered = times_s[stream.trajectory.covers(times_s)][:_TRIED].tolist()
    width, height = stream.source.sent_size
    for time_s, image in stream.source.images_at(covered):
        pose = stream.trajectory.pose(time_s)
        if pose is None:
            continue
        planes = VideoFrame.from_ndarray(image, format="rgb24").reformat(
            width=width, height=height, format="yuv420p"
        )
        time_ns = stream.trajectory.utc_ns(time_s)
        return Frame(stream.stream, 0, 0, time_s, time_ns, pose, planes)
    return None

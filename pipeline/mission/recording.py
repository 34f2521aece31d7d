"""One stream of a mission as its files give it: video, telemetry, camera."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipeline.config.camera import load_camera
from pipeline.config.mission import Mission, Stream, Telemetry, Uncertainty
from pipeline.errors import InputError
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.clock import Alignment, align, on_the_videos_clock
from pipeline.ingest.finding import Finding
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory import Trajectory
from pipeline.ingest.trajectory_of import Ground, trajectory_of
from pipeline.ingest.video.file import VideoInfo, check_video, sampled_indices
from pipeline.ingest.video.metadata import created_ns
from pipeline.mission.faults import Faults


@dataclass(frozen=True, eq=False)
class Recording:
    """What was read of one stream. angles: the track of ``telemetry.angles``."""

    stream: Stream
    video: VideoInfo
    track: Track
    angles: Track | None
    camera: Camera
    alignment: Alignment

    def trajectory(self, frame: LocalFrame, ground: Ground, uncertainty: Uncertainty) -> Trajectory:
        """The camera's way in the map frame."""
        return trajectory_of(
            self.track,
            self.stream.telemetry,
            frame,
            ground,
            offset_s=self.alignment.offset_s,
            angles=self.angles,
            uncertainty=uncertainty,
        )

    def findings(self, trajectory: Trajectory) -> list[Finding]:
        """What was assumed of the telemetry, and what of it was not used."""
        where = str(self.stream.telemetry.file)
        reasons = [self.alignment.reason] if self.alignment.reason else []
        found = [Finding("assumed", "assumed", where, text) for text in (*trajectory.assumed, *reasons)]
        if trajectory.clock == "local":
            text = "the zone of its times is not known; results say local time (telemetry.utc_offset)"
            found.append(Finding("assumed", "clock_local", where, text))
        for reason, count in self.track.left_out.items():
            first = self.track.first_left_out.get(reason, where)
            text = f"{count} samples left out: {reason.replace('_', ' ')}"
            found.append(Finding("warning", "left_out", where, text, f"the first is {first}"))
        return found


def read_recording(path: Path, mission: Mission, stream: Stream, thorough: bool) -> Recording:
    """Read the files of a stream. path: of the mission. Raises InputError with every independent fault."""
    faults = Faults()
    with faults.collected():
        video = check_video(stream.video, thorough)
        rate_hz = mission.processing.frame_rate
        sampled_indices(video.frames, video.frame_rate, rate_hz, where=f"{path} processing.frame_rate")
    with faults.collected():
        track = read_telemetry(stream.telemetry)
    with faults.collected():
        camera = load_camera(stream.camera)
    angles = None
    if stream.telemetry.angles is not None:
        with faults.collected():
            own = stream.telemetry.angles
            kept = Telemetry(file=own.file, format=own.format, columns=own.columns, table=own.table)
            angles = read_telemetry(kept)
    faults.raise_if_any()
    if (video.width, video.height) != (camera.width, camera.height):
        raise InputError(
            f"{stream.camera} width, height",
            f"{camera.width} x {camera.height}",
            f"the size of {stream.video}, {video.width} x {video.height}",
        )
    alignment = align(
        track, stream.telemetry, video.duration_s, created_ns(stream.video), stream.telemetry.file
    )
    if angles is not None and stream.telemetry.angles is not None:
        angles = on_the_videos_clock(angles, stream.telemetry.angles, track, alignment)
    return Recording(stream, video, track, angles, camera, alignment)

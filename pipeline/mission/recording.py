"""One stream of a mission as its files give it: video, telemetry, camera."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.config.mission import Mission, Stream
from pipeline.config.telemetry import Telemetry
from pipeline.config.uncertainty import Uncertainty
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.cameras.calibration_file import read_calibration
from pipeline.ingest.cameras.choice import ChosenCamera, PictureFacts, choose_camera
from pipeline.ingest.cameras.picture_facts import picture_facts
from pipeline.ingest.clock import Alignment, align, on_the_videos_clock
from pipeline.ingest.finding import Finding
from pipeline.ingest.joined import joined
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.sampling import require_rate
from pipeline.ingest.telemetry.stills_metadata import camera_of, dated_stills
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory import Trajectory
from pipeline.ingest.trajectory_of import Ground, trajectory_of
from pipeline.ingest.video.recordings import Recordings, open_recordings
from pipeline.ingest.video.stills import StillsSource, open_stills
from pipeline.mission.faults import Faults


@dataclass(frozen=True, eq=False)
class Recording:
    """What was read of one stream. angles: the track of ``telemetry.angles``."""

    stream: Stream
    video: Recordings | StillsSource
    track: Track
    angles: Track | None
    chosen: ChosenCamera
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
            focal_reference_mm=self.chosen.focal_length_35mm,
        )

    @property
    def camera(self) -> Camera:
        """The camera of the stream, as it was chosen."""
        return self.chosen.camera

    def findings(self, trajectory: Trajectory) -> list[Finding]:
        """What was assumed of the telemetry, and what of it was not used."""
        where = str(self.stream.telemetry.file)
        reasons = [self.alignment.reason] if self.alignment.reason else []
        found = list(self.video.findings)
        found += [Finding("assumed", "camera", where, text) for text in self.chosen.assumed]
        found += [Finding("assumed", "assumed", where, text) for text in (*trajectory.assumed, *reasons)]
        if trajectory.clock == "local":
            text = "the zone of its times is not known; results say local time (telemetry.utc_offset)"
            found.append(Finding("assumed", "clock_local", where, text))
        for reason, count in self.track.left_out.items():
            first = self.track.first_left_out.get(reason, where)
            text = f"{count} samples left out: {reason.replace('_', ' ')}"
            found.append(Finding("warning", "left_out", where, text, f"the first is {first}"))
        return found


#: the pictures, and the camera that stills say they are of
Opened = tuple[Recordings | StillsSource, Camera | None]


def read_recording(
    path: Path, mission: Mission, stream: Stream, opened: Callable[[], Opened] | None = None
) -> Recording:
    """Read the files of a stream. path: of the mission. opened: gives its pictures, if somebody opens them already.

    Raises InputError with every independent fault.
    """
    faults = Faults()
    with faults.collected():
        video, calibrated = open_source(mission, stream) if opened is None else opened()
        if video.info.constant:
            where = f"{path} processing.frame_rate"
            require_rate(mission.processing.frame_rate, video.info.frame_rate, where)
    tracks = []
    for file in stream.telemetry.files:
        with faults.collected():
            tracks.append(read_telemetry(stream.telemetry.model_copy(update={"file": file})))
    if stream.camera.file is not None:
        with faults.collected():
            read_calibration(stream.camera.file)
    angles = None
    if stream.telemetry.angles is not None:
        with faults.collected():
            own = stream.telemetry.angles
            kept = Telemetry(file=own.file, format=own.format, columns=own.columns, table=own.table)
            angles = read_telemetry(kept)
    faults.raise_if_any()
    track = joined(tracks, video.offsets_s, stream.telemetry.file)
    chosen = choose_camera(stream.camera, _facts(path, stream, video, track, calibrated))
    alignment = align(
        track,
        stream.telemetry,
        video.end_s,
        video.created_ns if isinstance(video, Recordings) else None,
        stream.telemetry.file,
    )
    if angles is not None and stream.telemetry.angles is not None:
        angles = on_the_videos_clock(angles, stream.telemetry.angles, track, alignment)
    return Recording(stream, video, track, angles, chosen, alignment)


def _facts(
    path: Path, stream: Stream, video: Recordings | StillsSource, track: Track, calibrated: Camera | None
) -> PictureFacts:
    """What telemetry and pictures say of the camera. path: of the mission."""
    size = video.info.width, video.info.height
    return picture_facts(f"{path} streams.{stream.id}", size, stream.videos, track, calibrated)


def open_source(mission: Mission, stream: Stream) -> Opened:
    """The pictures of a stream. Raises InputError if they cannot be used."""
    if stream.stills is None:
        return open_recordings(stream.videos, stream.start, stream.end, _threads(mission)), None
    stills, _ = dated_stills(stream.stills)
    times_s = np.array([((s.date_ns or 0) - (stills[0].date_ns or 0)) * 1e-9 for s in stills])
    return open_stills(tuple(s.path for s in stills), times_s, stream.start, stream.end), camera_of(stills)


def _threads(mission: Mission) -> int:
    """The streams are decoded beside each other."""
    cores = os.cpu_count() or 1
    return mission.processing.decoding_threads or max(1, cores // len(mission.streams))

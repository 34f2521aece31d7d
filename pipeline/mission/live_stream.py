"""One live stream of a mission, as its first seconds give it: pictures, telemetry, camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pipeline.config.mission import Mission, Stream
from pipeline.config.uncertainty import Uncertainty
from pipeline.errors import InputError
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.geoid import undulation_m
from pipeline.ingest.cameras.calibration_file import read_calibration
from pipeline.ingest.cameras.choice import ChosenCamera, choose_camera
from pipeline.ingest.cameras.picture_facts import picture_facts
from pipeline.ingest.finding import Finding
from pipeline.ingest.live.health import CAPTURE_TIMES
from pipeline.ingest.live.live_trajectory import LiveTrajectory, WayRecipe
from pipeline.ingest.live.probe import Probed, probe_live
from pipeline.ingest.live.source import LiveSource
from pipeline.ingest.source import SourceInfo
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory_of import Ground
from pipeline.ingest.video.recordings import even


@dataclass(frozen=True, eq=False)
class LiveRecording:
    """What a live stream said so far."""

    stream: Stream
    probed: Probed
    chosen: ChosenCamera

    @property
    def track(self) -> Track:
        """The first telemetry."""
        return self.probed.track

    @property
    def camera(self) -> Camera:
        """The camera of the stream, as it was chosen."""
        return self.chosen.camera

    @property
    def info(self) -> SourceInfo:
        """Of its pictures."""
        p = self.probed
        return SourceInfo(p.width, p.height, p.rate_hz, None, None, constant=False)

    def source(self, frame: LocalFrame, ground: Ground, uncertainty: Uncertainty) -> LiveSource:
        """The pictures, and as its ``way`` that of the camera. Raises InputError for telemetry that says too little."""
        assert self.stream.url is not None
        # what the first seconds told must not change in flight
        known = {"sensor_azimuth": self.probed.azimuth_reading} if self.probed.azimuth_reading else {}
        telemetry = self.stream.telemetry.model_copy(update=known)
        if telemetry.height == "relative" and telemetry.takeoff_height is None:
            found = "heights above take-off of a live stream, whose drone may be in flight already"
            raise InputError(telemetry.file, found, "telemetry.takeoff_height, or height: absolute")
        here = Ground(ground.datum, _unknown_m, undulation_m)
        recipe = WayRecipe(telemetry, frame, here, uncertainty, self.chosen.focal_length_35mm)
        way = LiveTrajectory(recipe.trajectory(self.track), recipe)
        info = self.info
        size = even(info.width, info.height)
        first = (0.0, self.probed.first)
        return LiveSource(
            self.stream.id,
            self.stream.url,
            self.stream.live,
            telemetry,
            info,
            size,
            self.probed.start_ns,
            way,
            first,
        )

    def findings(self, way: LiveTrajectory) -> list[Finding]:
        """What was found in one line, and what was assumed."""
        p, url = self.probed, str(self.stream.url)
        times = self.track.times_s
        span_s = float(times[-1] - times[0])
        beside = "KLV" if self.stream.telemetry.heard == self.stream.url else str(self.stream.telemetry.file)
        each = f", {(len(times) - 1) / span_s:.1f} positions a second" if span_s > 0.0 else ""
        text = (
            f"live: {p.codec} {p.width} x {p.height} at {p.rate_hz:.1f} Hz{each} from {beside}; "
            f"capture times {CAPTURE_TIMES[p.basis]}"
        )
        found = [Finding("assumed", "live", url, text)]
        if p.refused_s:
            late = "after it arrived" if p.refused_s > 0.0 else "before it arrived"
            text = f"its clock is not believed: pictures taken {abs(p.refused_s):.1f} s {late}"
            mend = "set the clock of the sender, and this machine's"
            found.append(Finding("warning", "live_clock", url, text, "", mend))
        found += [Finding("assumed", "camera", url, text) for text in self.chosen.assumed]
        return found + [Finding("assumed", "assumed", url, text) for text in way.assumed]


def _unknown_m(east: float, north: float) -> float:
    return math.nan


def read_live(path: object, mission: Mission, stream: Stream) -> LiveRecording:
    """Look at a live stream. path: of the mission. Raises InputError if it cannot be used."""
    where = f"{path} streams.{stream.id}"
    if stream.camera.file is not None:
        read_calibration(stream.camera.file)
    assert stream.url is not None
    probed = probe_live(where, stream.id, stream.url, stream.live, stream.telemetry)
    facts = picture_facts(where, (probed.width, probed.height), (), probed.track, None)
    return LiveRecording(stream, probed, choose_camera(stream.camera, facts))

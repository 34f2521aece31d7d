"""What a video file holds: probed by its index and a few of its pictures, never by all of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from pipeline.errors import InputError
from pipeline.ingest.finding import Finding
from pipeline.ingest.video.container import EXPECTED, NOT_SOUGHT, opened, video_tracks
from pipeline.ingest.video.decode import shown_frames
from pipeline.ingest.video.index import PictureIndex, has_own_index, read_index
from pipeline.ingest.video.metadata import created_of
from pipeline.ingest.video.upright import HLG, PQ, Upright, upright_of
from pipeline.messages import FloatArray

#: pictures that are decoded to see that it can be done: at these shares of the file
_PROBED = (0.0, 0.25, 0.5, 0.75, 1.0)
#: a probe that has not met a whole picture after so many packets gives up
_MOST_PACKETS = 400
#: an interval of so many usual ones is a gap
_GAP_PICTURES = 3.0


@dataclass(frozen=True, slots=True)
class VideoInfo:
    """What a video file holds. width, height: upright, pixels. frame_rate: Hz, the usual one. codec: FFmpeg's name.

    frames: that the file promises, damaged ones too. duration_s: from the first to the end of the last.
    """

    path: Path
    width: int
    height: int
    frame_rate: float
    frames: int
    duration_s: float
    codec: str


@dataclass(frozen=True, slots=True, eq=False)
class VideoFile:
    """A probed file. constant: whether its pictures keep the rate. findings: what was noticed and assumed.

    created_ns: when the recording began by its metadata, ns since 1970, UTC; None if they do not say.
    """

    info: VideoInfo
    index: PictureIndex
    upright: Upright
    constant: bool
    findings: tuple[Finding, ...]
    created_ns: int | None = None

    @property
    def slack_s(self) -> float:
        """By so much a picture may come after a tick and be in time: its time was rounded to the file's unit."""
        return 1.001 * min(self.index.tick_s, 1e-3)


def open_video(path: Path) -> VideoInfo:
    """What the file holds. Raises InputError as probe_video does."""
    return probe_video(path).info


def probe_video(path: Path) -> VideoFile:
    """Read the index, and decode a few pictures spread over the file.

    Raises InputError for a file that is missing, empty, no video, or of which no picture can be decoded.
    """
    with opened(path) as (container, stream):
        rate = float(stream.average_rate or stream.guessed_rate or 0.0)
        codec, aspect = stream.codec_context.name, stream.sample_aspect_ratio
        findings = _of_tracks(path, container, stream)
        sought = container.format.name not in NOT_SOUGHT
        created = created_of(container)
        index = read_index(path, container, stream)
        if not len(index.times_s):
            raise InputError(path, "a video without a picture", EXPECTED)
        first, lost = None, 0
        for frame in _probed(path, container, stream, index, sought):
            first = frame if first is None else first
            lost += frame is None
    if first is None:
        raise InputError(path, "no picture that can be decoded", EXPECTED)
    upright = upright_of(first, aspect)
    rate_hz, constant = _rate(index, rate)
    end_s = float(index.times_s[-1]) + 1.0 / rate_hz
    duration_s = len(index.times_s) / rate_hz if constant else end_s
    info = VideoInfo(path, *upright.size, rate_hz, len(index.times_s), duration_s, codec)
    findings += _of_pictures(path, first, upright)
    findings += _of_times(path, index, rate_hz, lost)
    return VideoFile(info, index, upright, constant, tuple(findings), created)


def decoded_frames(path: Path) -> Iterator[VideoFrame]:
    """Every picture as FFmpeg's own frame, as it is coded.

    Raises InputError with the number of the first one that is damaged.
    """
    whole = "a video that is neither truncated nor damaged"
    with opened(path) as (container, stream):
        promised, index = stream.frames, -1
        for index, (_, frame) in enumerate(shown_frames(container, stream)):
            if not isinstance(frame, VideoFrame):
                raise InputError(f"{path} frame {index}", "a damaged picture", whole)
            yield frame
    if index + 1 < promised:
        raise InputError(path, f"{index + 1} whole pictures of {promised} promised", whole)


def _rate(index: PictureIndex, average_hz: float) -> tuple[float, bool]:
    """The usual rate, and whether every picture keeps it."""
    steps = np.diff(index.times_s)
    steps = steps[steps > 0.0]
    if not len(steps):
        return (average_hz if 0.0 < average_hz < 1000.0 else 1.0), True
    usual_s = float(np.median(steps))
    slack_s = min(2.0 * index.tick_s, 0.2 * usual_s)
    if np.abs(steps - usual_s).max() > slack_s:
        return 1.0 / usual_s, False
    mean_hz = len(steps) / float(steps.sum())
    return (average_hz if abs(average_hz / mean_hz - 1.0) < 0.01 else mean_hz), True


def _probed(
    path: Path, container: InputContainer, stream: VideoStream, index: PictureIndex, sought: bool
) -> Iterator[VideoFrame | None]:
    """A picture near each share of the file, the first only where a time leads nowhere; None if it cannot be had."""
    last_s = float(index.times_s[max(0, index.whole - 1)])
    with ExitStack() as anew:
        if not has_own_index(container, stream):  # its packets were read to their end
            container, stream = anew.enter_context(opened(path))
        for share in _PROBED:
            if share > 0.0:
                ticks = index.first_ticks + round(share * last_s / index.tick_s)
                try:
                    container.seek(ticks, stream=stream, backward=True)
                except (av.FFmpegError, OSError, ValueError):
                    yield None
                    continue
            yield _next_whole(container, stream)
            if len(index.times_s) == 1 or not sought:
                return


def _next_whole(container: InputContainer, stream: VideoStream) -> VideoFrame | None:
    try:
        for number, packet in enumerate(container.demux(stream)):
            if number >= _MOST_PACKETS:
                break
            try:
                frames = stream.codec_context.decode(packet if packet.size else None)
            except (av.FFmpegError, ValueError):
                continue
            for frame in frames:
                if not frame.is_corrupt:
                    return frame
    except (av.FFmpegError, ValueError):
        return None
    return None


def _of_tracks(path: Path, container: InputContainer, stream: VideoStream) -> list[Finding]:
    tracks = video_tracks(container)
    if len(tracks) < 2:
        return []
    sizes = ", ".join(
        f"{s.index}: {s.codec_context.width} x {s.codec_context.height}" for s in tracks if s.codec_context
    )
    text = f"{len(tracks)} video tracks ({sizes}); track {stream.index} is used"
    return [Finding("assumed", "video_track", str(path), text)]


def _of_pictures(path: Path, frame: VideoFrame, upright: Upright) -> list[Finding]:
    size = f"{upright.size[0]} x {upright.size[1]}"
    found = []
    if upright.is_turned:
        found.append(f"turned as its display matrix says, to {size}")
    if upright.aspect != 1:
        found.append(f"pixels {float(upright.aspect):.4g} as wide as high, made square: {size}")
    if int(frame.color_trc) in (PQ, HLG):
        curve = "PQ" if int(frame.color_trc) == PQ else "HLG"
        found.append(f"HDR ({curve}); its brightness is used as it is coded, which looks pale")
    return [Finding("assumed", "picture", str(path), text) for text in found]


def _of_times(path: Path, index: PictureIndex, rate_hz: float, lost: int) -> list[Finding]:
    findings, promised = [], len(index.times_s)
    if index.whole < promised:
        text = f"{index.whole} whole pictures of {promised} promised; the others are {index.others}"
        findings.append(Finding("warning", index.others, str(path), text, "", "copy the file again"))
    if lost:
        text = f"no whole picture near {lost} of {len(_PROBED)} probed places"
        findings.append(Finding("warning", "damaged", str(path), text, "", "copy the file again"))
    gaps = _gaps(index.times_s, rate_hz)
    if gaps:
        text = f"{len(gaps)} gap(s) without a picture, {sum(g for _, g in gaps):.2f} s in all"
        findings.append(
            Finding("warning", "video_gap", str(path), text, f"the first after {gaps[0][0]:.2f} s")
        )
    return findings


def _gaps(times_s: FloatArray, rate_hz: float) -> list[tuple[float, float]]:
    """Time before, and length beyond one interval, of each gap."""
    steps = np.diff(times_s)
    at = np.flatnonzero(steps > _GAP_PICTURES / rate_hz)
    return [(float(times_s[k]), float(steps[k]) - 1.0 / rate_hz) for k in at]

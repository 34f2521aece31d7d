"""One recording or several in a row as the source of a stream."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
from av.video.frame import VideoFrame
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.ingest.finding import Finding
from pipeline.ingest.sampling import is_sampled, sampled
from pipeline.ingest.source import LostPicture, PassedPicture, Picture, SourceInfo
from pipeline.ingest.video.container import NOT_SOUGHT, opened
from pipeline.ingest.video.decode import NotShown, shown_frames
from pipeline.ingest.video.file import VideoFile, probe_video
from pipeline.ingest.video.index import exact_times_s
from pipeline.messages import FloatArray

#: containers state whole seconds of when a recording began: a gap shorter than this is none, seconds
_SHORTEST_GAP_S = 2.0
#: longer than this between two files is another flight, seconds
_LONGEST_GAP_S = 6 * 3600.0


@dataclass(frozen=True, slots=True, eq=False)
class _Shown:
    index: int
    time_s: float
    frame: VideoFrame | None
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Recordings:
    """A Source. files: with the time at which each begins. start_s, end_s: the part that is used.

    sent_size: of the planes that it gives, even, at most the picture's. threads: that decode.
    """

    files: tuple[tuple[VideoFile, float], ...]
    start_s: float
    end_s: float
    sent_size: tuple[int, int]
    threads: int = 1
    findings: tuple[Finding, ...] = ()

    @property
    def paths(self) -> tuple[Path, ...]:
        """The video files."""
        return tuple(file.info.path for file, _ in self.files)

    @property
    def created_ns(self) -> int | None:
        """When the first file began by its metadata, ns since 1970, UTC; None if they do not say."""
        return self.files[0][0].created_ns

    @property
    def offsets_s(self) -> list[float]:
        """When each file begins."""
        return [offset_s for _, offset_s in self.files]

    @property
    def times_s(self) -> FloatArray:
        """When the pictures of the used part are shown, by the files' indices."""
        times_s = np.concatenate([offset_s + file.index.times_s for file, offset_s in self.files])
        return times_s[(times_s >= self.start_s) & (times_s < self.end_s)]

    @property
    def info(self) -> SourceInfo:
        """Of the used part; rate and size are the same in all files."""
        first = self.files[0][0]
        return SourceInfo(
            first.info.width,
            first.info.height,
            first.info.frame_rate,
            len(self.times_s),
            self.end_s,
            self.start_s,
            all(file.constant for file, _ in self.files),
        )

    def pictures(self, rate_hz: float) -> Iterator[Picture | LostPicture | PassedPicture]:
        """As Source says; a lost picture costs no tick if the one before it is there."""
        slack_s = max(file.slack_s for file, _ in self.files)
        upright = self.files[0][0].upright
        lost: list[_Shown] = []

        def whole() -> Iterator[_Shown]:
            for shown in self._shown(rate_hz, slack_s):
                if shown.frame is not None or shown.reason == "unneeded":
                    yield shown
                else:
                    lost.append(shown)

        for shown, tick in sampled(whole(), rate_hz, slack_s, 1.0 / self.info.frame_rate):
            yield from _lost_before(lost, shown.index)
            if tick is None or shown.frame is None:
                yield PassedPicture(shown.index, shown.time_s)
            else:
                planes = upright.planes(shown.frame, *self.sent_size)
                yield Picture(shown.index, shown.time_s, tick, planes)
        yield from _lost_before(lost, None)

    def images_at(self, times_s: Iterable[float]) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        """As Source says; a file that can be searched by time is read from the last picture that stands alone."""
        upright = self.files[0][0].upright
        for time_s, frame in self._frames_at(times_s):
            yield time_s, upright.rgb(frame)

    def planes_at(self, times_s: Iterable[float]) -> Iterator[tuple[float, VideoFrame]]:
        """As Source says, read as images_at does."""
        upright = self.files[0][0].upright
        for time_s, frame in self._frames_at(times_s):
            yield time_s, upright.planes(frame, *self.sent_size)

    def _frames_at(self, times_s: Iterable[float]) -> Iterator[tuple[float, VideoFrame]]:
        wanted = sorted(set(times_s))
        for (file, offset_s), end_s in zip(self.files, self._ends_s(), strict=True):
            own = [t for t in wanted if offset_s - file.slack_s <= t < end_s - file.slack_s]
            if own:
                yield from _frames_at(file, offset_s, own, self.threads)

    def exact_times_s(self) -> FloatArray:
        """As Source says."""
        times_s = np.concatenate([offset_s + exact_times_s(f.info.path) for f, offset_s in self.files])
        return times_s[(times_s >= self.start_s) & (times_s < self.end_s)]

    def resized(self, width: int, height: int) -> Recordings:
        """As Source says."""
        return replace(self, sent_size=(width, height))

    def _ends_s(self) -> list[float]:
        return [offset_s for _, offset_s in self.files[1:]] + [np.inf]

    def _shown(self, rate_hz: float, slack_s: float) -> Iterator[_Shown]:
        """Every picture of the used part; what the files promise and do not hold is missing.

        One that is not sampled, and that no sampled one refers to, is not decoded.
        """
        index = -1
        for file, offset_s in self.files:
            ended = index

            def needed(from_s: float, until_s: float, offset_s: float = offset_s) -> bool:
                return is_sampled(offset_s + from_s, offset_s + until_s, rate_hz, slack_s)

            for time_s, frame in _file_frames(file, self.start_s - offset_s, self.threads, needed):
                index += 1
                at_s = offset_s + time_s
                if at_s >= self.end_s:
                    return
                if at_s < self.start_s or frame == "skipped":
                    continue
                if isinstance(frame, str):
                    yield _Shown(index, at_s, None, frame)
                else:
                    yield _Shown(index, at_s, frame, "")
            for time_s in file.index.times_s[index - ended :]:
                index += 1
                if self.start_s <= offset_s + time_s < self.end_s:
                    yield _Shown(index, offset_s + float(time_s), None, "missing")


def open_recordings(
    paths: Sequence[Path], start_s: float | None = None, end_s: float | None = None, threads: int = 1
) -> Recordings:
    """Probe the files. start_s, end_s: the part that is used, absent: all.

    Raises InputError for what cannot be read, a change of size between files, and a part without a picture.
    """
    files = [probe_video(path) for path in paths]
    for file in files[1:]:
        if file.upright != files[0].upright:
            found = f"{file.info.width} x {file.info.height} pixels"
            expected = f"{files[0].info.width} x {files[0].info.height}, as {files[0].info.path} has"
            raise InputError(file.info.path, found, expected)
    placed, findings = _placed(files)
    last, offset_s = placed[-1]
    whole_s = offset_s + last.info.duration_s
    sent_size = even(*files[0].upright.size)
    part = max(0.0, start_s or 0.0), min(whole_s, end_s if end_s is not None else whole_s)
    source = Recordings(
        tuple(placed), *part, sent_size, threads, (*(g for f in files for g in f.findings), *findings)
    )
    if not len(source.times_s):
        found = f"start {part[0]:g} s and end {part[1]:g} s"
        raise InputError(paths[0], found, f"a part of the video, which lasts {whole_s:.2f} s")
    return source


def even(width: int, height: int) -> tuple[int, int]:
    """The largest even size in a size: what a codec can encode."""
    return max(2, width - width % 2), max(2, height - height % 2)


def _placed(files: list[VideoFile]) -> tuple[list[tuple[VideoFile, float]], list[Finding]]:
    """Each file after the one before; a gap between them by what their metadata say of when they began."""
    placed, findings, offset_s = [(files[0], 0.0)], [], 0.0
    for before, file in pairwise(files):
        offset_s += before.info.duration_s
        began = before.created_ns, file.created_ns
        gap_s = 0.0
        text = "taken to follow the file before without a gap"
        if began[0] is not None and began[1] is not None:
            gap_s = (began[1] - began[0]) * 1e-9 - before.info.duration_s
            if not _SHORTEST_GAP_S <= gap_s <= _LONGEST_GAP_S:
                gap_s = 0.0
            else:
                text = f"{gap_s:.1f} s after the end of the file before, by their metadata"
        offset_s += gap_s
        findings.append(Finding("assumed", "recordings", str(file.info.path), text))
        placed.append((file, offset_s))
    return placed, findings


def _file_frames(
    file: VideoFile, from_s: float, threads: int, needed: Callable[[float, float], bool]
) -> Iterator[tuple[float, VideoFrame | NotShown]]:
    """Time since the file's first picture, and the frame, of every picture. needed: as is_sampled, by such times."""
    first, tick_s = file.index.first_ticks, file.index.tick_s
    from_ticks = None if from_s <= 0.0 else first + int(from_s / tick_s)
    with opened(file.info.path, threads) as (container, stream):

        def needed_ticks(ticks: int, until: int) -> bool:
            return needed((ticks - first) * tick_s, (until - first) * tick_s)

        for ticks, frame in shown_frames(container, stream, from_ticks, needed_ticks):
            yield (ticks - first) * tick_s, frame


def _frames_at(
    file: VideoFile, offset_s: float, times_s: list[float], threads: int
) -> Iterator[tuple[float, VideoFrame]]:
    first, tick_s = file.index.first_ticks, file.index.tick_s
    for wanted_s in times_s:
        with opened(file.info.path, threads) as (container, stream):
            ticks = first + round((wanted_s - offset_s) / tick_s)
            if container.format.name not in NOT_SOUGHT:
                with suppress(av.FFmpegError):
                    container.seek(ticks, stream=stream, backward=True)
            frames = shown_frames(container, stream, ticks)
            found = next(((at, frame) for at, frame in frames if at >= ticks), None)
            if found is not None and found[0] == ticks and isinstance(found[1], VideoFrame):
                yield wanted_s, found[1]


def _lost_before(lost: list[_Shown], index: int | None) -> Iterator[LostPicture]:
    while lost and (index is None or lost[0].index < index):
        one = lost.pop(0)
        yield LostPicture(one.index, one.time_s, one.reason)

"""Which file of a stream holds a picture, and where in it: what a person needs to look at it again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.ingest.source import Source
from pipeline.ingest.video.recordings import Recordings
from pipeline.ingest.video.stills import StillsSource


@dataclass(frozen=True)
class InFile:
    """name: of the file, without its folder. time_s: since its first picture. frame: its number, from 0.

    A still has neither time nor number: it is its file.
    """

    name: str
    time_s: float | None = None
    frame: int | None = None


def in_file(source: Source, time_s: float) -> InFile | None:
    """Of the picture nearest to a time of the stream; None of a stream that comes from no file."""
    if isinstance(source, StillsSource):
        return InFile(source.files[int(np.argmin(np.abs(source.times - time_s)))].name)
    if not isinstance(source, Recordings):
        return None
    slack_s = source.files[0][0].slack_s
    file, offset_s = [pair for pair in source.files if pair[1] <= time_s + slack_s or pair[1] == 0.0][-1]
    frame = int(np.argmin(np.abs(file.index.times_s - (time_s - offset_s))))
    return InFile(file.info.path.name, float(file.index.times_s[frame]), frame)

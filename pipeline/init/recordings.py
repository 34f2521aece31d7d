"""Recordings in a row: a camera cuts its video at 4 GB, and what it cut is one stream."""

from __future__ import annotations

import re
from collections.abc import Sequence

from pipeline.ingest.video.file import VideoInfo

#: between the end of one part and the start of the next, by their dates of whole seconds
_SEAM_S = 2.5
_NUMBER = re.compile(r"(\d+)(?!.*\d)")
#: what cameras write before they cut
_CUT_BYTES = 3.5e9


def in_rows(videos: Sequence[VideoInfo], began_ns: Sequence[int | None]) -> list[list[int]]:
    """Numbers of the videos that follow one another, a list for each stream; the videos are in order of name."""
    rows: list[list[int]] = []
    for number in range(len(videos)):
        if rows and _goes_on(videos, began_ns, rows[-1][-1], number):
            rows[-1].append(number)
        else:
            rows.append([number])
    return rows


def _goes_on(videos: Sequence[VideoInfo], began_ns: Sequence[int | None], before: int, after: int) -> bool:
    first, second = videos[before], videos[after]
    alike = (first.width, first.height, first.codec) == (second.width, second.height, second.codec)
    if first.path.parent != second.path.parent or not alike or _number(second) != _number(first) + 1:
        return False
    start, following = began_ns[before], began_ns[after]
    if start is not None and following is not None:
        return abs((following - start) * 1e-9 - first.duration_s) <= _SEAM_S
    return first.path.stat().st_size >= _CUT_BYTES


def _number(video: VideoInfo) -> int:
    found = _NUMBER.search(video.path.stem)
    return int(found.group(1)) if found else -(10**9)

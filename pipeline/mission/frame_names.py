"""From the name of a picture's file to its stream, and its number or time in the video."""

from __future__ import annotations

import re
from collections.abc import Mapping

_NUMBERS = re.compile(r"\d+")
#: ``t12.5``, ``12.5s``, ``00-01-23.450`` at the end of a name
_SECONDS = re.compile(r"(?:(?<![a-zA-Z0-9])t=?(\d+(?:\.\d+)?)|(?<![\d.])(\d+(?:\.\d+)?)s)$")
_CLOCK = re.compile(r"(?<!\d)(\d{1,2})[-_:](\d{2})[-_:](\d{2}\.\d+)$")


def stream_of(name: str, streams: Mapping[str, str]) -> str | None:
    """The stream that a name means. streams: its id, by what may stand for it (id, video file, its stem).

    The longest that stands in the name between signs that are no letters or digits; the only stream, if there
    is but one and the name says none.
    """
    found = [key for key in streams if _stands_in(key, name)]
    if found:
        best = max(found, key=len)
        rivals = {streams[key] for key in found if len(key) == len(best)}
        return streams[best] if len(rivals) == 1 else None
    ids = set(streams.values())
    return ids.pop() if len(ids) == 1 else None


def time_in(name: str, key: str = "") -> float | None:
    """Seconds of the video in a file's name, or None."""
    stem = _stem(name, key)
    if (match := _CLOCK.search(stem)) is not None:
        return int(match.group(1)) * 3600.0 + int(match.group(2)) * 60.0 + float(match.group(3))
    if (match := _SECONDS.search(stem)) is not None:
        return float(match.group(1) or match.group(2))
    return None


def number_in(name: str, key: str = "") -> int | None:
    """The last number in a file's name, without what stands for the stream (key); None: there is none."""
    numbers = _NUMBERS.findall(_stem(name, key))
    return int(numbers[-1]) if numbers and len(numbers[-1]) < 10 else None


def key_in(name: str, streams: Mapping[str, str]) -> str:
    """What stands for the stream in a name; empty if nothing does."""
    return max((key for key in streams if _stands_in(key, name)), key=len, default="")


def _stands_in(key: str, name: str) -> bool:
    return (
        bool(key)
        and re.search(rf"(?<![a-z0-9]){re.escape(key.lower())}(?![a-z0-9])", name.lower()) is not None
    )


def _stem(name: str, key: str) -> str:
    last = re.split(r"[/\\]", name)[-1]
    if key:
        last = re.sub(rf"(?i){re.escape(key)}", "", last)
    return re.sub(r"\.[A-Za-z]\w{1,4}$", "", last)

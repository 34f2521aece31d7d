"""Cues of a subtitle file, wherever it is damaged."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

_TIME = r"(\d{1,30}):(\d{1,30}):(\d{1,30})[,.](\d{1,30})"
_ARROW_LINE = re.compile(r"^[^\n]*-->[^\n]*$", re.MULTILINE)
_TIME_LINE = re.compile(rf"\s*{_TIME}\s*-->\s*{_TIME}.*")
_COUNTER = re.compile(r"\n[^\S\n]*\d+[^\S\n]*\n?\Z")
_UNTIMED = re.compile(r"^[^\S\n]*\d+[^\S\n]*\n(.+?)(?=\n[^\S\n]*\n|\n*\Z)", re.DOTALL | re.MULTILINE)
_TAG = re.compile(r"<[^>]*>|\{\\[^}]*\}")
#: a cue that lasts longer than this has a damaged end
_LONGEST_S = 3600.0


@dataclass(frozen=True, slots=True)
class Cue:
    """where: file and line of the text. start_s, end_s: None in a dialect without time lines."""

    where: str
    start_s: float | None
    end_s: float | None
    text: str


def without_tags(text: str) -> str:
    """Text without the formatting of subtitles, line ends as ``\\n``."""
    return _TAG.sub("", text.replace("\0", "").replace("\r\n", "\n").replace("\r", "\n"))


def cues_of(path: object, text: str) -> list[Cue]:
    """The cues in the order of the file, without formatting tags; a damaged one does not end the file."""
    found = list(_ARROW_LINE.finditer(text))
    if not found:
        return [
            Cue(f"{path}:{_line(text, match.start(1))}", None, None, _TAG.sub("", match.group(1)))
            for match in _UNTIMED.finditer(text)
        ]
    cues = []
    line, position = 1, 0
    for match, following in zip(found, [*found[1:], None], strict=True):
        body = text[match.end() : len(text) if following is None else following.start()]
        if following is not None:
            body = _COUNTER.sub("", body)
        start_of_text = match.end() + len(body) - len(body.lstrip())
        line += text.count("\n", position, start_of_text)
        position = start_of_text
        cues.append(Cue(f"{path}:{line}", *_times_s(match.group()), _TAG.sub("", body).strip()))
    return cues


def _times_s(line: str) -> tuple[float, float | None]:
    """Start and end of a time line; NaN for a start that cannot be read, None for an end that cannot be right."""
    times = _TIME_LINE.fullmatch(line)
    if times is None:
        return math.nan, None
    start_s, end_s = _seconds(times.groups()[:4]), _seconds(times.groups()[4:])
    return start_s, end_s if start_s < end_s <= start_s + _LONGEST_S else None


def _seconds(parts: tuple[str, ...]) -> float:
    hours, minutes, seconds, fraction = parts
    return 3600.0 * int(hours) + 60.0 * int(minutes) + int(seconds) + int(fraction) / 10.0 ** len(fraction)


def _line(text: str, position: int) -> int:
    return text.count("\n", 0, position) + 1

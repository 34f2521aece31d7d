"""Cues of a subtitle file, wherever it is damaged."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import dataclass

import numpy as np

_TIME = r"(?:(\d{1,30})\s*:\s*)?(\d{1,30})\s*:\s*(\d{1,30})(?:\s*[,.]\s*(\d{1,30})|:(\d{3}))?"
#: hours and fractions may be absent (WebVTT); settings may follow
TIME_LINE = re.compile(rf"\s*{_TIME}\s*-->\s*{_TIME}.*")
_UNTIMED = re.compile(r"^[^\S\n]*\d+[^\S\n]*\n(.+?)(?=\n[^\S\n]*\n|\n*\Z)", re.DOTALL | re.MULTILINE)
_TAG = re.compile(r"<[^>]*>|\{\\[^}]*\}")
_USUAL = b"00:00:00,000 --> 00:00:00,000"
#: what each digit of a time counts, milliseconds
_PLACES_MS = np.array([36_000_000, 3_600_000, 600_000, 60_000, 10_000, 1000, 100, 10, 1])
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
    lines = _time_lines(text)
    if not lines:
        return [
            Cue(f"{path}:{_line(text, match.start(1))}", None, None, _TAG.sub("", match.group(1)))
            for match in _UNTIMED.finditer(text)
        ]
    times_s = _times_s([text[begin:end] for begin, end in lines])
    cues, name = [], str(path)
    line, position = 1, 0
    following = [*(begin for begin, _ in lines[1:]), None]
    for (_, end), next_begin, (start_s, end_s) in zip(lines, following, times_s, strict=True):
        body = text[end:next_begin] if next_begin is None else _without_counter(text[end:next_begin])
        start_of_text = end + len(body) - len(body.lstrip())
        line += text.count("\n", position, start_of_text)
        position = start_of_text
        cues.append(Cue(f"{name}:{line}", start_s, end_s, _plain(body.strip())))
    return cues


def _plain(text: str) -> str:
    """Text without tags. Most cues have one about all of them, and no other."""
    if text.startswith("<") and text.endswith(">"):
        begin, end = text.find(">") + 1, text.rfind("<")
        if begin <= end:
            text = text[begin:end].strip()
    return _TAG.sub("", text).strip() if "<" in text or "{" in text else text


def _time_lines(text: str) -> list[tuple[int, int]]:
    """Where the lines with an arrow begin and end."""
    found = []
    arrow = text.find("-->")
    while arrow >= 0:
        end = text.find("\n", arrow)
        end = len(text) if end < 0 else end
        found.append((text.rfind("\n", 0, arrow) + 1, end))
        arrow = text.find("-->", end)
    return found


def _without_counter(body: str) -> str:
    """Without the number of the next cue, a line of its own at the end; one empty line may follow it."""
    whole = body.removesuffix("\n")
    before, new_line, last = whole.rpartition("\n")
    return before if new_line and last.strip().isdecimal() else body


def _times_s(lines: list[str]) -> list[tuple[float, float | None]]:
    """Starts and ends of time lines; NaN for a start that cannot be read, None for an end that cannot be right."""
    usual = _usual_times_s(lines)
    if usual is not None:
        return [_start_and_end(start_s, end_s) for start_s, end_s in usual]
    parts = [None if (m := TIME_LINE.fullmatch(line)) is None else m.groups() for line in lines]
    thousandths = _are_thousandths([p[:5] for p in parts if p is not None])
    return [
        (math.nan, None)
        if part is None
        else _start_and_end(_seconds(part[:5], thousandths), _seconds(part[5:], thousandths))
        for part in parts
    ]


def _start_and_end(start_s: float, end_s: float) -> tuple[float, float | None]:
    return start_s, end_s if start_s < end_s <= start_s + _LONGEST_S else None


def _usual_times_s(lines: list[str]) -> list[list[float]] | None:
    """The same at once, where every line is as the standard wants it: ``00:00:00,000 --> 00:00:00,000``."""
    if any(len(line) != len(_USUAL) or not line.isascii() for line in lines):
        return None
    signs = np.frombuffer("".join(lines).encode("ascii"), np.uint8).reshape(len(lines), -1)
    usual = np.frombuffer(_USUAL, np.uint8)
    is_digit = usual == ord("0")
    digits = signs[:, is_digit].astype(np.int64) - ord("0")
    if (signs[:, ~is_digit] != usual[~is_digit]).any() or (digits < 0).any() or (digits > 9).any():
        return None
    milliseconds = digits.reshape(len(lines), 2, -1) @ _PLACES_MS
    times_s: list[list[float]] = (milliseconds / 1000.0).tolist()
    return times_s


def _are_thousandths(starts: list[tuple[str | None, ...]]) -> bool:
    """Whether ``00:00:01,33`` is 1.033 s: writers that do not pad their thousandths; by which order is the better."""
    if len({len(start[3] or "") for start in starts}) < 2:
        return False
    falls = [
        sum(b < a for a, b in itertools.pairwise(_seconds(start, as_thousandths) for start in starts))
        for as_thousandths in (False, True)
    ]
    return falls[1] < falls[0]


def _seconds(parts: tuple[str | None, ...], thousandths: bool) -> float:
    hours, minutes, seconds, fraction, behind_colon = parts
    whole = 3600.0 * int(hours or 0) + 60.0 * int(minutes or 0) + int(seconds or 0)
    digits = fraction or behind_colon
    if digits is None:
        return whole
    return whole + int(digits) / (1000.0 if thousandths else 10.0 ** len(digits))


def _line(text: str, position: int) -> int:
    return text.count("\n", 0, position) + 1

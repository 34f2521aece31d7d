"""Cells of a table to numbers: decimal commas, units behind the number, degrees with minutes and seconds, flags."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

import numpy as np

from pipeline.ingest.tables.units import Dimension, factor
from pipeline.messages import FloatArray

_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\D*)")
_DMS = re.compile(
    r"([NSEW])?\s*([+-]?\d+(?:\.\d+)?)\s*[°ºd:\s]?\s*"
    r"(?:(\d+(?:\.\d+)?)\s*['′’m:\s]?\s*(?:(\d+(?:\.\d+)?)\s*(?:\"|″|”|''|s)?\s*)?)?([NSEW])?"
)
_NMEA = re.compile(r"([NSEW])?\s*([+-]?)(\d{1,3}?)(\d{2}(?:\.\d+)?)\s*([NSEW])?")
_TRUE = ("1", "true", "yes", "on", "recording", "rec", "starting", "start", "started", "1.0")
_FALSE = ("0", "false", "no", "off", "", "stop", "stopped", "stopping", "none", "0.0", "idle")


def number(text: str, decimal: str = ".", unit_of: Dimension | None = None) -> float:
    """A number, NaN if the text is none. A known unit behind it is applied, where unit_of names a dimension.

    Groups of thousands (``1.234,5``) are understood where the decimal sign is a comma.
    """
    plain = text.strip().replace("\u2212", "-")
    if decimal == ",":
        plain = plain.replace(".", "").replace(",", ".") if "," in plain else plain
    match = _NUMBER.fullmatch(plain)
    if match is None:
        return math.nan
    scale: float | None = 1.0
    if match.group(2).strip():
        scale = factor(match.group(2), unit_of) if unit_of else None
    value = float(match.group(1))
    return value * scale if scale is not None and math.isfinite(value) else math.nan


def numbers(cells: Iterable[str], decimal: str, unit_of: Dimension | None = None) -> FloatArray:
    """float64 (N,), NaN where a cell is no number."""
    return np.array([number(cell, decimal, unit_of) for cell in cells], np.float64)


def degrees(text: str, decimal: str = ".") -> float:
    """A latitude or longitude in degrees: a number, or degrees with minutes and seconds, N, S, E or W about it."""
    value = number(text, decimal)
    if not math.isnan(value):
        return value
    plain = text.strip().replace("\u2212", "-").replace(",", ".").upper().replace("D", "°").replace("M", "'")
    match = _DMS.fullmatch(plain)
    if match is None:
        return math.nan
    before, whole, minutes, seconds, after = match.groups()
    size = abs(float(whole)) + float(minutes or 0.0) / 60.0 + float(seconds or 0.0) / 3600.0
    if float(minutes or 0.0) >= 60.0 or float(seconds or 0.0) >= 60.0:
        return math.nan
    return -size if whole.startswith("-") or (before or after or "") in ("S", "W") else size


def nmea_degrees(text: str, decimal: str = ".") -> float:
    """``5824.1046N``, degrees and minutes without a sign between them (NMEA 0183), in degrees; NaN if it is not."""
    match = _NMEA.fullmatch(text.strip().replace(",", ".").upper())
    if match is None or float(match.group(4)) >= 60.0:
        return math.nan
    size = float(match.group(3)) + float(match.group(4)) / 60.0
    return -size if match.group(2) == "-" or (match.group(1) or match.group(5) or "") in ("S", "W") else size


def flags(cells: Iterable[str]) -> FloatArray:
    """1 for yes, 0 for no, NaN for what is neither; float64 (N,)."""
    return np.array([_flag(cell.strip().lower()) for cell in cells], np.float64)


def _flag(word: str) -> float:
    return 1.0 if word in _TRUE else 0.0 if word in _FALSE else math.nan

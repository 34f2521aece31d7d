"""Files that hold telemetry, but must be turned into something readable first: what to do is told."""

from __future__ import annotations

from pathlib import Path

from pipeline.errors import InputError

_SPREADSHEETS = (".xlsx", ".xlsm", ".xls", ".ods", ".numbers")
_FLIGHT_RECORD = (
    "a DJI flight record as the app keeps it, which is encrypted",
    "it decoded to CSV, by Airdata, Flight Reader, PhantomHelp or dji-log-parser",
)
_SPREADSHEET = ("a spreadsheet", "it saved as CSV")


def require_decoded(path: Path, head: bytes) -> None:
    """Raises InputError for a spreadsheet, or a flight record that was not decoded, with what to do."""
    reason = _reason(path, head)
    if reason is not None:
        raise InputError(path, *reason)


def _reason(path: Path, head: bytes) -> tuple[str, str] | None:
    name = path.name.lower()
    if name.endswith(_SPREADSHEETS):
        return _SPREADSHEET
    # a decoded record keeps its name, but is text
    if name.startswith("djiflightrecord") and name.endswith(".txt") and b"\0" in head[:4096]:
        return _FLIGHT_RECORD
    return None

"""The versions of the files that we write: each says what it is, and another version is refused by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.errors import InputError

#: of every JSON document and GeoTIFF that we write; raised when its meaning changes
VERSIONS = {
    "evaluation": 1,
    "map": 1,
    "places": 1,
    "plan": 1,
    "remaining": 1,
    "search area": 1,
    "second look": 1,
    "summary": 1,
    "tracks": 1,
}


def stamp(kind: str) -> dict[str, Any]:
    """The keys that a document of a kind begins with."""
    return {"format": f"searchlight {kind}", "version": VERSIONS[kind]}


def require_version(document: Mapping[str, Any], kind: str, where: object) -> None:
    """Raises InputError for a document of another kind or version; one without these keys is of the first."""
    found = document.get("format", f"searchlight {kind}"), document.get("version", 1)
    if found != (f"searchlight {kind}", VERSIONS[kind]):
        expected = f"searchlight {kind} of version {VERSIONS[kind]}"
        raise InputError(f"{where} format, version", f"{found[0]} of version {found[1]}"[:200], expected)

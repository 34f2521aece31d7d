"""What a video's container says of itself, beside its pictures."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import av
from av.container import InputContainer

#: a camera whose clock was never set writes 1904 or 1970
_FIRST_YEAR = 1990


def created_ns(path: Path) -> int | None:
    """When the recording began by the container's own metadata, ns since 1970, UTC; None if it does not say."""
    try:
        with av.open(str(path)) as container:
            return created_of(container)
    except (av.FFmpegError, OSError, ValueError):
        return None


def created_of(container: InputContainer) -> int | None:
    """As created_ns, of an open container."""
    try:
        moment = datetime.fromisoformat(container.metadata.get("creation_time", ""))
    except ValueError:
        return None
    if moment.year < _FIRST_YEAR:
        return None
    return round((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp() * 1e9)

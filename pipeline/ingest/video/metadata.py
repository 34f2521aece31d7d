"""What a video's container says of itself, beside its pictures."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import av

#: a camera whose clock was never set writes 1904 or 1970
_FIRST_YEAR = 1990


def created_ns(path: Path) -> int | None:
    """When the recording began by the container's own metadata, ns since 1970, UTC; None if it does not say."""
    try:
        with av.open(str(path)) as container:
            text = container.metadata.get("creation_time", "")
        moment = datetime.fromisoformat(text)
    except (av.FFmpegError, OSError, ValueError):
        return None
    if moment.year < _FIRST_YEAR:
        return None
    return round((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp() * 1e9)

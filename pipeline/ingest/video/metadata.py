"""What a video's container says of itself, beside its pictures."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import av
from av.container import InputContainer

#: where containers say which camera it was; an encoder is named there too, unless it is a drone
_MODELS = ("com.apple.quicktime.model", "com.android.model", "model", "encoder")
_MAKES = ("com.apple.quicktime.make", "com.android.manufacturer", "make")
_ENCODERS_ARE = ("dji", "skydio", "parrot", "autel")
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


def camera_names(path: Path) -> tuple[str, ...]:
    """What the container calls the camera, the best name first; none if it does not."""
    try:
        with av.open(str(path)) as container:
            tags = {key.lower(): value.strip("\0 ") for key, value in container.metadata.items()}
    except (av.FFmpegError, OSError, ValueError):
        return ()
    make = next((tags[key] for key in _MAKES if tags.get(key)), "")
    names = []
    for key in _MODELS:
        name = tags.get(key, "")
        if not name or (key == "encoder" and not name.lower().startswith(_ENCODERS_ARE)):
            continue
        names.append(name if name.lower().startswith(make.lower()) else f"{make} {name}")
    return tuple(names)

"""How large the pictures of a stream are sent: as large as the largest network wants them, not larger."""

from __future__ import annotations

from collections.abc import Iterable

from pipeline.ingest.source import Source
from pipeline.ingest.video.recordings import even

#: a picture that would be made smaller by less than this is sent as it is: one more scaling costs sharpness
_LEAST_SHRINKING = 2.0


def as_sent(source: Source, wanted: Iterable[tuple[int, int] | None]) -> Source:
    """The source, its planes at the size that is sent. wanted: as in sent_size."""
    return source.resized(*sent_size((source.info.width, source.info.height), wanted))


def sent_size(picture: tuple[int, int], wanted: Iterable[tuple[int, int] | None]) -> tuple[int, int]:
    """Width and height, even, of what is encoded of a picture (width, height, pixels).

    wanted: the input sizes of the networks; None: one takes any size, so the picture is sent whole. The smallest
    size of the picture's shape in which no network has to enlarge either side.
    """
    sizes = list(wanted)
    if not sizes or None in sizes:
        return even(*picture)
    scale = max(max(size[0] / picture[0], size[1] / picture[1]) for size in sizes if size is not None)
    if scale * _LEAST_SHRINKING > 1.0:
        return even(*picture)
    width, height = (-(-round(side * scale, 6) // 2) * 2 for side in picture)
    return int(width), int(height)

"""Pictures in files."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import av
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError


def read_picture(file: Path) -> NDArray[np.uint8]:
    """uint8 (H, W, 3) RGB. Raises InputError."""
    try:
        with av.open(str(file)) as container:
            frame = next(container.decode(video=0))
            return cast("NDArray[np.uint8]", frame.to_ndarray(format="rgb24"))
    except (av.FFmpegError, OSError, StopIteration, IndexError):
        raise InputError(file, "a file that is no picture", "a JPEG, PNG, WebP or BMP picture") from None

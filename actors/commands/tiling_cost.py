"""What a tiling costs on a 4K frame, and how large somebody may be for it, in words."""

from __future__ import annotations

import resource
import time
from typing import TYPE_CHECKING

from actors.terminal import say

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from pipeline.detection import Detector
    from pipeline.sensor.setup import Tiling

#: width and height of the frames that tilings are compared on
FRAME_4K = (3840, 2160)


def say_tiling(tiling: Tiling, mean_s: float, memory_bytes: float) -> None:
    """mean_s: of a 4K frame. memory_bytes: peak of a process that looks at one."""
    from pipeline.detection.tiles import whole_up_to, windows_of

    count, (wide, high) = len(windows_of(*FRAME_4K, tiling)), whole_up_to(*FRAME_4K, tiling)
    say(
        f"tiles: {count} looks at a frame of {FRAME_4K[0]} x {FRAME_4K[1]}:"
        f" {1e3 * mean_s:.0f} ms, {memory_bytes / 1e6:.0f} MB in all;"
        f" people up to {wide} x {high} pixels are seen whole by one of them wherever they are"
    )


def say_tiling_of(detector: Detector, image: NDArray[np.uint8]) -> None:
    """The same, measured here and now on a 4K frame made of a picture (H, W, 3)."""
    import numpy as np

    tiling = detector.setup.tiling
    if tiling is None:
        return
    width, height = FRAME_4K
    repeats = -(-height // image.shape[0]), -(-width // image.shape[1]), 1
    frame = np.ascontiguousarray(np.tile(image, repeats)[:height, :width])
    detector.detect(frame)
    started = time.perf_counter()
    detector.detect(frame)
    taken_s = time.perf_counter() - started
    say_tiling(tiling, taken_s, 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)

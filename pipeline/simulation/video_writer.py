"""The drone's recording: H.264 in MP4, constant frame rate."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

from pipeline.config.scenario import Recording


def write_video(path: Path, images: Iterable[NDArray[np.uint8]], recording: Recording) -> None:
    """Encode pictures (H, W, 3) uint8 RGB as they come. One thread: the same bytes on any machine."""
    with av.open(str(path), "w", format="mp4") as container:
        stream = None
        for image in images:
            if stream is None:
                options = {
                    "preset": recording.preset,
                    "threads": "1",
                    "g": str(2 * round(recording.frame_rate)),
                }
                stream = container.add_stream("libx264", rate=round(recording.frame_rate), options=options)
                stream.height, stream.width = image.shape[:2]
                stream.pix_fmt, stream.bit_rate = "yuv420p", round(recording.bitrate)
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")):
                container.mux(packet)
        if stream is not None:
            container.mux(stream.encode(None))

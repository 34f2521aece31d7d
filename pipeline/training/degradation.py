"""What the link does to a picture: the project's own codec at a low bitrate, in a moving shot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.link.codec import Decoder, Encoder

_FRAMES = 5
_FRAME_RATE_HZ = 10.0
_LARGEST_STEP_PX = 12


def degrade(image: NDArray[np.uint8], bitrate_bps: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """The picture (H, W, 3) as the last of a short pan that was encoded at the bitrate and decoded again.

    The pan moves by a random number of whole pixels per picture and ends at the picture itself, so that boxes
    stay where they are, and the artefacts are those of predicted pictures.
    """
    step = rng.integers(-_LARGEST_STEP_PX, _LARGEST_STEP_PX + 1, 2)
    height, width = image.shape[:2]
    encoder = Encoder("h264", width, height, _FRAME_RATE_HZ, bitrate_bps, keyframe_interval=50)
    decoder = Decoder("h264")
    for i in range(_FRAMES):
        shift = step * (_FRAMES - 1 - i)
        shown = np.ascontiguousarray(np.roll(image, shift, axis=(0, 1)))
        decoded = decoder.decode(encoder.encode(shown, i, keyframe=i == 0).data)
    return decoded

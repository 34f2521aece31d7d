"""The detector stage: the packets of one substream become detections."""

from __future__ import annotations

import contextlib
import time
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.detection import NotFiniteError
from pipeline.link.codec import Codec, Decoder
from pipeline.messages import Detections, EndOfStream, FloatArray, Hops, Message, Packet
from pipeline.mission.stages.inbox import BUSY, dropped


class Looks(Protocol):
    """What finds boxes in a picture, see ``pipeline.detection.Detector``."""

    def detect(self, image: NDArray[np.uint8]) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
        """Boxes (N, 4) in pixels, scores (N,), class ids (N,)."""


class DetectorStage:
    """One decoder and one detector; call it with the messages of its substream in their order."""

    def __init__(self, detector: Looks, codec: Codec) -> None:
        self._detector = detector
        self._decoder = Decoder(codec)

    def process(self, message: Message, received_ns: int, wait_s: float = 0.0) -> Message:
        """Detections for a packet, or Dropped if it cannot be decoded or the network says NaN of it.

        The end of the stream comes back as it is.

        received_ns: when the message arrived, ns UTC. wait_s: how long it has waited since.
        """
        if isinstance(message, EndOfStream):
            return message
        if not isinstance(message, Packet):
            raise TypeError(f"a substream carries packets, not {type(message).__name__}")
        started = time.perf_counter()
        try:
            image = self._decoder.decode(message.data)
        except ValueError:
            return dropped(message, "undecodable")
        decoded = time.perf_counter()
        try:
            boxes, scores, classes = self._detector.detect(image)
        except NotFiniteError:
            return dropped(message, "detector_not_finite")
        detected = time.perf_counter()
        transfer_s = max(0, received_ns - message.sent_ns) * 1e-9 if message.sent_ns else message.link_s
        return Detections(
            stream=message.stream,
            detector=message.detector,
            index=message.index,
            time_ns=message.time_ns,
            pose=message.pose,
            boxes_px=_in_own_picture(boxes, image, message),
            scores=scores,
            class_ids=classes,
            hops=Hops(
                encode_s=message.encode_s,
                transfer_s=transfer_s,
                decode_s=decoded - started,
                detect_s=detected - decoded,
                source_s=message.source_s,
                wait_s=wait_s,
            ),
            epoch=message.epoch,
            sequence=message.sequence,
        )

    def skip(self, message: Message) -> Message:
        """Decode, since the next packet needs this one, but do not look: the frame came too late."""
        if not isinstance(message, Packet):
            return message
        with contextlib.suppress(ValueError):
            self._decoder.decode(message.data)
        return dropped(message, BUSY)


def _in_own_picture(boxes: FloatArray, image: NDArray[np.uint8], packet: Packet) -> FloatArray:
    """Boxes of an image in pixels of the stream's picture, of which the image is a smaller copy."""
    height, width = image.shape[:2]
    if not packet.width or (packet.width, packet.height) == (width, height):
        return boxes
    scale = np.array([packet.width / width, packet.height / height] * 2)
    return np.asarray(boxes * scale)

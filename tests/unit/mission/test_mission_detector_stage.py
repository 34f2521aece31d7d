"""What becomes of a packet whose picture the network cannot judge."""

from __future__ import annotations

import numpy as np

from pipeline.detection import NotFiniteError
from pipeline.link.codec import Encoder
from pipeline.messages import CameraPose, Dropped, Packet
from pipeline.mission.stages.detector import DetectorStage


class Broken:
    def detect(self, image):
        raise NotFiniteError


def test_a_picture_of_which_the_network_says_nan_is_dropped_and_counted_not_taken_for_empty():
    encoded = Encoder("h264", 64, 48, 10.0, 1e5, 10).encode(np.zeros((48, 64, 3), np.uint8), 0)
    pose = CameraPose(np.zeros(3), np.eye(3))
    packet = Packet("a", "d", 7, 70, 0, 1, 10, encoded.keyframe, pose, encoded.data)
    result = DetectorStage(Broken(), "h264").process(packet, 0)
    assert result == Dropped("a", "d", 7, 70, "detector_not_finite")

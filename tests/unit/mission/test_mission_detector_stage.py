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
    packet = Packet("a", "d", 7, 70, 0, 1, 10, encoded.keyframe, pose, encoded.data, epoch=2, sequence=5)
    result = DetectorStage(Broken(), "h264").process(packet, 0)
    assert result == Dropped("a", "d", 7, 70, "detector_not_finite", epoch=2, sequence=5)


def test_a_result_carries_the_epoch_and_the_number_of_its_packet():
    class Finds:
        def detect(self, image):
            return np.zeros((0, 4)), np.zeros(0), np.zeros(0, dtype=np.int64)

    encoded = Encoder("h264", 64, 48, 10.0, 1e5, 10).encode(np.zeros((48, 64, 3), np.uint8), 0)
    pose = CameraPose(np.zeros(3), np.eye(3))
    packet = Packet("a", "d", 7, 70, 0, 1, 10, encoded.keyframe, pose, encoded.data, epoch=3, sequence=4)
    result = DetectorStage(Finds(), "h264").process(packet, 0)
    assert (result.epoch, result.sequence) == (3, 4)

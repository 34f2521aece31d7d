"""The detectors that the project ships find the people of a small simulated scene, seen by no training."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.config.pool import load_pool
from pipeline.detection import load_detector
from pipeline.detection.nms import iou

CONFIGS = Path(__file__).parents[3] / "configs"
POOL = {detector.id: detector for detector in load_pool(CONFIGS / "pools" / "demo.yaml").detectors}


@pytest.fixture(scope="module")
def pictures():
    from pipeline.simulation.dataset import MISSION_VIEWS, pictures_of_scene

    return list(pictures_of_scene(940000, "mission", 6, MISSION_VIEWS))


@pytest.mark.parametrize(("name", "share"), [("nano", 0.6), ("small", 0.75)])
def test_a_shipped_detector_finds_people_in_rendered_pictures(pictures, name, share):
    detector = load_detector(POOL[name].model, score_threshold=POOL[name].score_threshold)
    found = seen = wrong = 0
    for picture in pictures:
        boxes, _, _ = detector.detect(picture.image)
        clear = picture.boxes_px[picture.visible_shares > 0.5]
        seen += len(clear)
        found += sum(bool((iou(box, boxes) > 0.4).any()) for box in clear)
        wrong += sum(not (iou(box, picture.boxes_px) > 0.2).any() for box in boxes)
    assert seen >= 5
    assert found >= share * seen
    assert wrong <= 0.5 * seen


def test_a_shipped_detector_takes_pictures_of_any_size():
    detector = load_detector(POOL["nano"].model, score_threshold=0.0)
    for height, width in [(480, 640), (1080, 1920), (333, 77)]:
        boxes, _, _ = detector.detect(np.zeros((height, width, 3), np.uint8))
        assert boxes.min() >= 0.0
        assert (boxes.max(axis=0) <= [width, height, width, height]).all()

"""The detectors that the project ships find the people of a small simulated scene, seen by no training."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.config.pool import load_pool
from pipeline.detection import load_detector
from pipeline.detection.nms import iou

CONFIGS = Path(__file__).parents[3] / "configs"
FOLDER = CONFIGS / "detectors"
POOL = load_pool(CONFIGS / "pools" / "demo.yaml").detectors
#: from the smallest to the largest
FAMILY = ("nano", "small", "medium", "large")
CARDS = {name: yaml.safe_load((FOLDER / f"{name}.card.yaml").read_text()) for name in FAMILY}


@pytest.fixture(scope="module")
def pictures():
    from pipeline.simulation.dataset import MISSION_VIEWS, pictures_of_scene

    return list(pictures_of_scene(940000, "mission", 6, MISSION_VIEWS))


def found_seen_wrong(detector, pictures) -> tuple[int, int, int]:
    """Clear people found, clear people in all, and boxes that touch nobody."""
    found = seen = wrong = 0
    for picture in pictures:
        boxes, _, _ = detector.detect(picture.image)
        clear = picture.boxes_px[picture.visible_shares > 0.5]
        seen += len(clear)
        found += sum(bool((iou(box, boxes) > 0.4).any()) for box in clear)
        wrong += sum(not (iou(box, picture.boxes_px) > 0.2).any() for box in boxes)
    return found, seen, wrong


@pytest.mark.parametrize(
    ("name", "share"), [("nano", 0.5), ("small", 0.6), ("medium", 0.75), ("large", 0.75)]
)
def test_a_shipped_detector_finds_people_in_rendered_pictures(pictures, name, share):
    score = CARDS[name]["held_out"]["clean"]["score"]
    found, seen, wrong = found_seen_wrong(
        load_detector(FOLDER / f"{name}.onnx", score_threshold=score), pictures
    )
    assert seen >= 5
    assert found >= share * seen
    assert wrong <= 0.5 * seen


@pytest.mark.parametrize("detector", POOL, ids=lambda detector: detector.id)
def test_the_demo_s_detectors_find_people_at_the_pool_s_threshold(pictures, detector):
    opened = load_detector(detector.model, score_threshold=detector.score_threshold)
    found, seen, wrong = found_seen_wrong(opened, pictures)
    assert found >= 0.6 * seen
    assert wrong <= 0.3 * seen


def test_a_shipped_detector_takes_pictures_of_any_size():
    detector = load_detector(FOLDER / "nano.onnx", score_threshold=0.0)
    for height, width in [(480, 640), (1080, 1920), (333, 77)]:
        boxes, _, _ = detector.detect(np.zeros((height, width, 3), np.uint8))
        assert boxes.min() >= 0.0
        assert (boxes.max(axis=0) <= [width, height, width, height]).all()


def test_the_family_s_costs_are_far_apart_and_its_files_small():
    costs = [CARDS[name]["cost"]["gigaflop"] for name in FAMILY]
    assert costs == sorted(costs)
    assert costs[0] <= 0.1
    assert costs[-1] >= 30 * costs[0]
    assert all((FOLDER / f"{name}.onnx").stat().st_size < 6e6 for name in FAMILY)


@pytest.mark.parametrize("size", ["small", "medium", "large"])
def test_by_the_cards_a_larger_detector_finds_people_of_every_size_better(size):
    precision = [CARDS[name]["held_out"]["by_size"][size]["ap"] for name in FAMILY]
    assert all(lesser < greater for lesser, greater in pairwise(precision))


@pytest.mark.parametrize("name", FAMILY)
def test_a_card_says_how_its_detector_is_trained(name):
    recipe = yaml.safe_load((FOLDER / f"{name}.train.yaml").read_text())
    assert recipe == {key: value for key, value in CARDS[name]["training"].items() if value is not None}

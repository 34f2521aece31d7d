from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.training.augmentation import AugmentationParams, random_crop
from pipeline.training.config import load_training
from pipeline.training.degradation import degrade
from pipeline.training.pictures import PictureSet, open_pictures, shots

NANO = Path(__file__).parents[3] / "configs" / "detectors" / "nano.train.yaml"


@pytest.fixture(scope="module")
def params() -> AugmentationParams:
    calm = {"light": 0.0, "tint": 0.0, "noise": 0.0, "blur": 0.0, "crop": 96, "on_person": 1.0}
    return load_training(NANO).augmentation.model_copy(update=calm)


@pytest.fixture(scope="module")
def white_box() -> PictureSet:
    image = np.zeros((1, 288, 512, 3), np.uint8)
    image[0, 100:180, 200:260] = 255
    return PictureSet(image, image, [np.array([[200.0, 100.0, 260.0, 180.0]])], [np.ones(1)])


def test_boxes_follow_the_pixels_through_every_crop(white_box, params):
    for seed in range(40):
        crop = random_crop(white_box, 256, params, np.random.default_rng(seed))
        y, x = np.nonzero(crop.image[..., 0] > 127)
        (box,) = [*crop.people, *crop.ignored]
        np.testing.assert_allclose(box, [x.min(), y.min(), x.max() + 1, y.max() + 1], atol=1.01)


def test_the_same_seed_gives_the_same_crop(white_box, params):
    noisy = params.model_copy(update={"noise": 9.0, "light": 0.3, "tint": 0.1})
    a, b = (random_crop(white_box, 256, noisy, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(a.image, b.image)
    np.testing.assert_array_equal(a.people, b.people)


def test_people_hardly_visible_are_ignored(white_box, params):
    hidden = PictureSet(white_box.clean, white_box.degraded, white_box.boxes_px, [np.array([0.1])])
    crop = random_crop(hidden, 256, params, np.random.default_rng(0))
    assert len(crop.people) == 0
    assert len(crop.ignored) == 1


def test_degradation_keeps_the_picture_in_place_and_loses_detail():
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (18, 32, 3), dtype=np.uint8).repeat(16, 0).repeat(16, 1)
    poor, good = (degrade(image, bitrate, np.random.default_rng(1)) for bitrate in (5e4, 5e6))
    error_poor, error_good = (np.abs(x.astype(int) - image).mean() for x in (poor, good))
    assert error_good < error_poor < 40


def test_pictures_are_spread_evenly_over_scenes():
    plan = shots(100, 3, 10, "train", None)
    assert [s.seed for s in plan] == [100, 101, 102]
    assert [s.first for s in plan] == [0, 3, 6]
    assert sum(s.count for s in plan) == 10


def test_an_unfinished_picture_set_is_refused(tmp_path):
    from pipeline.errors import InputError

    with pytest.raises(InputError, match="no complete picture set"):
        open_pictures(tmp_path, [])

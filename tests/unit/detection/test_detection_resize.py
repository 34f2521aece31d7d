from __future__ import annotations

import numpy as np
import pytest

from pipeline.detection.resize import resize

RNG = np.random.default_rng(0)


def test_halving_is_the_mean_of_blocks():
    image = RNG.integers(0, 256, (576, 1024, 3), dtype=np.uint8)
    mean = image.reshape(288, 2, 512, 2, 3).mean(axis=(1, 3))
    np.testing.assert_array_equal(resize(image, 512, 288), np.floor(mean + 0.5))


@pytest.mark.parametrize("factor", [3, 4])
def test_shrinking_by_a_whole_factor_is_the_mean_of_blocks(factor):
    image = RNG.integers(0, 256, (24 * factor, 36 * factor, 3), dtype=np.uint8)
    mean = image.reshape(24, factor, 36, factor, 3).mean(axis=(1, 3))
    assert np.abs(resize(image, 36, 24) - mean).max() <= 1.0


def test_area_weights_pixels_by_how_much_of_them_is_covered():
    image = np.array([[[0] * 3, [90] * 3, [180] * 3]], np.uint8)
    np.testing.assert_array_equal(resize(image, 2, 1)[0, :, 0], [30, 150])


@pytest.mark.parametrize("method", ["area", "linear", "triangle"])
def test_growing_interpolates_linearly_between_pixel_centres(method):
    image = np.array([[[0] * 3, [100] * 3]], np.uint8)
    np.testing.assert_array_equal(resize(image, 4, 1, method)[0, :, 0], [0, 25, 75, 100])


def test_linear_shrinking_takes_the_nearest_two_pixels():
    image = np.arange(0, 160, 10, dtype=np.uint8)[None, :, None].repeat(3, axis=2)
    np.testing.assert_array_equal(resize(image, 4, 1, "linear")[0, :, 0], [15, 55, 95, 135])


def test_an_image_of_the_right_size_is_returned_as_it_is():
    image = RNG.integers(0, 256, (32, 48, 3), dtype=np.uint8)
    assert resize(image, 48, 32) is image


def test_a_view_that_is_not_contiguous_is_resized_like_its_copy():
    image = RNG.integers(0, 256, (40, 60, 3), dtype=np.uint8)[:, ::-1]
    np.testing.assert_array_equal(resize(image, 31, 17), resize(image.copy(), 31, 17))

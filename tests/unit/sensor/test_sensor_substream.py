"""What a substream is worth, at its bitrate and under its codec."""

import math

import numpy as np
import pytest

from pipeline.config.pool import PoolDetector
from pipeline.sensor.setup import PLAIN, Setup, Tiling
from pipeline.sensor.substream import as_sent, calibration_at, found_by_distance, substream_model


def _detector(**changes):
    fields = {
        "id": "d",
        "memory": {"megabytes": 50},
        "calibration": {"scale": 3.0, "offset": 0.0},
        "accuracy": [
            {"bitrate": {"kbps": 100}, "accuracy": 0.2},
            {"bitrate": {"mbps": 10}, "accuracy": 0.8},
        ],
        "accuracy_by_codec": [
            {"codec": "h265", "bitrate": {"kbps": 100}, "accuracy": 0.4},
            {"codec": "h265", "bitrate": {"mbps": 10}, "accuracy": 0.8},
        ],
        "times": [{"machine": "m", "mean": {"milliseconds": 10}}],
    }
    return PoolDetector.model_validate(fields | changes)


def _point(kbps, scale, offset, share, codec="h264", **changes):
    found = [
        {"person_px_from": 16, "person_px_below": 36, "share": share, "people": 40},
        {"person_px_from": 36, "person_px_below": 64, "share": min(1.0, 2.0 * share), "people": 40},
    ]
    calibration = {"scale": scale, "offset": offset}
    point = {"codec": codec, "bitrate": {"kbps": kbps}, "picture_width": 1000, "false_boxes": 0.1}
    return point | {"calibration": calibration, "found": found} | changes


MEASURED = _detector(operating_points=[_point(10_000, 2.0, 1.0, 0.5), _point(100, 1.0, -3.0, 0.1)])


def test_without_operating_points_accuracy_at_the_bitrate_raises_and_lowers():
    model = substream_model(_detector(), "h264", 1e6, 0.8, PLAIN)
    assert model.raises == model.lowers == pytest.approx(0.5 / 0.8)
    assert model.probability_found(np.array([30.0]), 1000) is None


def test_the_accuracy_is_that_of_the_codec_where_the_pool_knows_it():
    assert substream_model(_detector(), "h265", 1e5, 0.8, PLAIN).raises == pytest.approx(0.5)
    assert substream_model(_detector(), "vp9", 1e5, 0.8, PLAIN).raises == pytest.approx(0.25)


def test_a_score_calibrated_at_the_bitrate_is_not_discounted_for_the_bitrate_again():
    model = substream_model(MEASURED, "h264", 1e5, 1.0, PLAIN)
    assert (model.raises, model.lowers) == (pytest.approx(0.8), pytest.approx(0.2))


def test_calibration_is_linear_in_the_logarithm_of_the_bitrate_and_level_beyond():
    for bitrate, scale, offset in ((1e6, 1.5, -1.0), (1e3, 1.0, -3.0), (1e9, 2.0, 1.0), (1e5, 1.0, -3.0)):
        found = calibration_at(MEASURED, "h264", bitrate)
        assert (found.scale, found.offset) == (pytest.approx(scale), pytest.approx(offset))
    assert as_sent(MEASURED, "h264", 1e6).calibration == calibration_at(MEASURED, "h264", 1e6)


def test_without_a_point_under_the_codec_the_calibration_is_that_of_all_conditions():
    assert calibration_at(MEASURED, "vp9", 1e6) == MEASURED.calibration
    uncalibrated = _point(100, 1.0, 0.0, 0.1)
    del uncalibrated["calibration"]
    assert calibration_at(_detector(operating_points=[uncalibrated]), "h264", 1e5).scale == 3.0


def test_the_share_found_is_of_the_size_in_the_evaluations_pixels():
    model = substream_model(MEASURED, "h264", 1e6, 0.8, PLAIN)
    middles = np.array([24.0, 48.0])
    np.testing.assert_allclose(model.probability_found(middles, 1000), [0.3, 0.6])
    # the same people in a camera's picture that is four times as wide are as large for the network
    np.testing.assert_allclose(model.probability_found(4.0 * middles, 4000), [0.3, 0.6])
    np.testing.assert_allclose(model.probability_found(np.array([4.0, 1.0, 1e4]), 1000), [0.0, 0.0, 0.6])
    assert 0.3 < model.probability_found(np.array([34.0]), 1000)[0] < 0.6


def test_in_tiles_people_are_as_large_as_in_the_picture():
    tiled = Setup(tiling=Tiling(640, 640, 0.2, False))
    model = substream_model(MEASURED, "h264", 1e6, 0.8, tiled)
    np.testing.assert_allclose(model.probability_found(np.array([24.0]), 4000), [0.3])


def test_sizes_that_were_not_measured_at_every_bitrate_are_left_out():
    short = _point(100, 1.0, -3.0, 0.1)
    short["found"] = short["found"][:1]
    model = substream_model(
        _detector(operating_points=[short, _point(10_000, 2.0, 1.0, 0.5)]), "h264", 1e6, 0.8, PLAIN
    )
    assert model.sizes_px == (4.0, pytest.approx(24.0))


def test_the_probability_falls_with_the_distance():
    model = substream_model(MEASURED, "h264", 1e7, 0.8, PLAIN)
    distances = np.linspace(0.0, 100.0, 50)
    found = found_by_distance(model, 900.0 * math.sqrt(0.85), 1000, distances)
    assert (np.diff(found) <= 0.0).all()
    assert found[0] == 1.0
    assert found[-1] < 0.3


def test_scores_that_were_not_calibrated_at_the_bitrate_hold_as_far_as_accuracy_does():
    assert substream_model(_detector(), "h264", 1e5, 0.8, PLAIN).trust == pytest.approx(0.25)
    assert substream_model(_detector(), "h264", 1e7, 0.8, PLAIN).trust == 1.0
    assert substream_model(MEASURED, "h264", 1e5, 0.8, PLAIN).trust == 1.0

"""Figures that others have published for real detections."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.evaluation.metrics.average_precision import coco_precision
from pipeline.evaluation.metrics.bootstrap import drawn_weights, interval, replicate
from pipeline.evaluation.metrics.lrp import OFFICIAL_THRESHOLDS, lrp_curve, mean_optimal_lrp, optimal_lrp
from pipeline.evaluation.metrics.matching import match

CLASSES = list(range(6))
#: of swimmer, boat, jetski, life-saving appliances, buoy, by pycocotools 2.0.11; class 0 has no boxes
CLASS_AP = [
    0.30398238313851234,
    0.6193377060436054,
    0.512264713810693,
    0.1412445603064215,
    0.3812332624483512,
]


def test_average_precision_is_the_published_one(real_boxes):
    true, found, images = real_boxes
    result = coco_precision(true, found, images, CLASSES)
    assert result.by_size["all"].ap == pytest.approx(0.3916125251495167, abs=1e-9)
    assert [result.ap_by_category[c] for c in CLASSES[1:]] == pytest.approx(CLASS_AP, abs=1e-9)
    assert np.isnan(result.ap_by_category[0])


@pytest.mark.parametrize(
    "thresholds", [None, OFFICIAL_THRESHOLDS], ids=["every score", "as the official code"]
)
def test_lrp_is_that_of_the_authors_code(real_boxes, thresholds):
    true, found, _ = real_boxes
    matches = match(true, found)
    optima = [optimal_lrp(lrp_curve(matches, c, thresholds)) for c in CLASSES]
    swimmer, boat = optima[1], optima[2]
    assert (swimmer.lrp, boat.lrp) == pytest.approx((0.690, 0.381), abs=0.003)
    parts = (swimmer.localisation, swimmer.false_positive, swimmer.false_negative)
    assert parts == pytest.approx((0.278, 0.159, 0.196), abs=0.003)
    assert mean_optimal_lrp(optima).lrp == pytest.approx(0.614, abs=0.003)


def test_every_picture_once_gives_the_figures_themselves(real_boxes):
    true, found, images = real_boxes
    matches = match(true, found)
    once = replicate(matches, np.ones((1, images)))
    precision = coco_precision(true, found, images, CLASSES).by_size["all"]
    assert once.ap[0] == pytest.approx(precision.ap, abs=1e-12)
    assert once.ap50[0] == pytest.approx(precision.ap50, abs=1e-12)
    assert once.ar100[0] == pytest.approx(precision.ar100, abs=1e-12)
    molrp = mean_optimal_lrp([optimal_lrp(lrp_curve(matches, c)) for c in CLASSES]).lrp
    assert once.molrp[0] == pytest.approx(molrp, abs=1e-12)


@pytest.mark.parametrize("size", ["small", "medium", "large"])
def test_our_matching_gives_the_librarys_precision_in_every_size_class(real_boxes, size):
    true, found, images = real_boxes
    ours = replicate(match(true, found, size), np.ones((1, images)))
    library = coco_precision(true, found, images, CLASSES).by_size[size]
    assert (ours.ap[0], ours.ap50[0], ours.ar100[0]) == pytest.approx(
        (library.ap, library.ap50, library.ar100), abs=1e-12
    )


def test_an_interval_holds_the_figure_and_narrows_with_more_sequences(real_boxes):
    true, found, images = real_boxes
    matches = match(true, found)
    widths = []
    for sequences in (8, 200):
        drawn = drawn_weights(np.arange(images) * sequences // images, 60, seed=1)
        low, high = interval(replicate(matches, drawn).ap)
        assert low < 0.3916 < high
        widths.append(high - low)
    assert widths[1] < widths[0]

"""LRP against a plain implementation, and what must not change it."""

from __future__ import annotations

import math
from collections import namedtuple

import numpy as np
import pytest

from pipeline.evaluation.metrics.boxes import FoundBoxes, TrueBoxes, found_boxes, true_boxes
from pipeline.evaluation.metrics.lrp import lrp_curve, optimal_lrp
from pipeline.evaluation.metrics.matching import AREAS, match

True1 = namedtuple("True1", "image category bbox area crowd")
Found1 = namedtuple("Found1", "image category bbox score")


def plain_overlap(a, b, crowd):
    x = max(0.0, min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0]))
    y = max(0.0, min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1]))
    whole = a[2] * a[3] if crowd else a[2] * a[3] + b[2] * b[3] - x * y
    return x * y / whole if x * y > 0.0 else 0.0


def plain_judgements(true, found, category, low, high):
    """(score, right, ignored, iou) of each found box: COCO's rules, one box after the other."""
    out = []
    for image in sorted({t.image for t in true} | {f.image for f in found}):
        theirs = [t for t in true if (t.image, t.category) == (image, category)]
        wanted = [t for t in theirs if not t.crowd and low <= t.area <= high]
        unwanted = [t for t in theirs if t.crowd or not low <= t.area <= high]
        mine = [f for f in found if (f.image, f.category) == (image, category)]
        taken = set()
        for f in sorted(mine, key=lambda f: -f.score)[:100]:
            best, partner = 0.5, None
            for group in (wanted, unwanted):
                for t in group:
                    iou = plain_overlap(f.bbox, t.bbox, t.crowd)
                    if iou >= best and (id(t) not in taken or t.crowd):
                        best, partner = iou, t
                if partner is not None:
                    taken.add(id(partner))
                    out.append((f.score, group is wanted, group is unwanted, best))
                    break
            else:
                area = f.bbox[2] * f.bbox[3]
                out.append((f.score, False, not low <= area <= high, 0.0))
    return out


def plain_lrp(true, found, category, threshold, low, high):
    judged = [j for j in plain_judgements(true, found, category, low, high) if j[0] >= threshold and not j[2]]
    total = sum(1 for t in true if t.category == category and not t.crowd and low <= t.area <= high)
    right = [1.0 - iou for _, is_right, _, iou in judged if is_right]
    wrong, missed = len(judged) - len(right), total - len(right)
    lrp = (sum(d / (1.0 - 0.5) for d in right) + wrong + missed) / (len(right) + wrong + missed)
    return (
        lrp,
        sum(right) / len(right) if right else math.nan,
        wrong / len(judged) if judged else math.nan,
        missed / total,
    )


def random_boxes(rng: np.random.Generator) -> tuple[TrueBoxes, FoundBoxes, float]:
    """Truth with crowds, and found boxes that partly match, with equal scores among them."""
    count, images = int(rng.integers(1, 14)), int(rng.integers(1, 5))
    corner, size = rng.uniform(0, 80, (count, 2)), rng.uniform(4, 110, (count, 2))
    true = true_boxes(
        rng.integers(0, images, count),
        rng.integers(1, 3, count),
        np.hstack([corner, size]),
        crowd=rng.random(count) < 0.15,
    )
    again = rng.integers(0, count, int(rng.integers(0, 25)))
    moved = true.bbox[again] + rng.normal(0, 3, (len(again), 4)) * rng.choice(
        [0.0, 1.0, 4.0], (len(again), 1)
    )
    moved[:, 2:] = np.maximum(moved[:, 2:], 1.0)
    levels = rng.choice([5, 1000])
    score = rng.integers(1, levels + 1, len(again)) / levels
    return true, found_boxes(true.image[again], true.category[again], moved, score), float(rng.random())


def listed(true, found):
    return (
        [
            True1(*row)
            for row in zip(true.image, true.category, true.bbox, true.area, true.crowd, strict=True)
        ],
        [Found1(*row) for row in zip(found.image, found.category, found.bbox, found.score, strict=True)],
    )


def check_against_plain(seed: int) -> None:
    rng = np.random.default_rng([5, seed])
    true, found, threshold = random_boxes(rng)
    size = list(AREAS)[int(rng.integers(0, 4))]
    plain_true, plain_found = listed(true, found)
    for category in (1, 2):
        curve = lrp_curve(match(true, found, size), category)
        if not len(curve.lrp):
            continue
        fixed = lrp_curve(match(true, found, size), category, np.array([threshold]))
        for c in (curve, fixed):
            for k, s in enumerate(c.threshold):
                got = (c.lrp[k], c.localisation[k], c.false_positive[k], c.false_negative[k])
                want = plain_lrp(plain_true, plain_found, category, s, *AREAS[size])
                np.testing.assert_allclose(got, want, rtol=0, atol=1e-12)


def test_lrp_is_that_of_a_plain_implementation_in_1000_cases():
    for seed in range(1000):
        check_against_plain(seed)


def optimum(true: TrueBoxes, found: FoundBoxes, category: int = 1) -> list[float]:
    best = optimal_lrp(lrp_curve(match(true, found), category))
    return [best.lrp, best.localisation, best.false_positive, best.false_negative, best.threshold]


def distinct(rng: np.random.Generator) -> tuple[TrueBoxes, FoundBoxes]:
    """As random_boxes, no two scores equal: among equals the order decides, in COCO's rules too."""
    true, found, _ = random_boxes(rng)
    return true, found_boxes(
        found.image, found.category, found.bbox, rng.permutation(len(found)) / 100 + 0.01
    )


@pytest.mark.parametrize("seed", range(30))
def test_neither_the_order_of_boxes_nor_of_pictures_changes_lrp(seed):
    rng = np.random.default_rng([6, seed])
    true, found = distinct(rng)
    shuffled = found.rows(rng.permutation(len(found)))
    np.testing.assert_allclose(optimum(true, shuffled), optimum(true, found), rtol=0, atol=1e-12)
    new = rng.permutation(10)
    renamed = (
        true_boxes(new[true.image], true.category, true.bbox, true.area, true.crowd),
        found_boxes(new[found.image], found.category, found.bbox, found.score),
    )
    np.testing.assert_allclose(optimum(*renamed), optimum(true, found), rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", range(30))
def test_scaling_all_boxes_does_not_change_lrp(seed):
    rng = np.random.default_rng([7, seed])
    true, found = distinct(rng)
    scaled = (
        true_boxes(true.image, true.category, true.bbox * 4.0, crowd=true.crowd),
        found_boxes(found.image, found.category, found.bbox * 4.0, found.score),
    )
    np.testing.assert_allclose(optimum(*scaled), optimum(true, found), rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", range(30))
def test_lrp_lies_between_zero_and_one_and_any_monotone_change_of_scores_keeps_it(seed):
    rng = np.random.default_rng([8, seed])
    true, found = distinct(rng)
    best = optimum(true, found)
    assert math.isnan(best[0]) or 0.0 <= best[0] <= 1.0
    bent = found_boxes(found.image, found.category, found.bbox, found.score**3)
    np.testing.assert_allclose(optimum(true, bent)[:4], best[:4], rtol=0, atol=1e-12)

"""The library of COCO's metrics against the authors' own code, on data of every kind."""

from __future__ import annotations

import contextlib
import io

import numpy as np
import pytest
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from pipeline.evaluation.metrics.average_precision import coco_precision
from pipeline.evaluation.metrics.boxes import FoundBoxes, TrueBoxes, found_boxes, true_boxes
from pipeline.evaluation.metrics.lrp import lrp_curve, optimal_lrp
from pipeline.evaluation.metrics.matching import match

IMAGES, CATEGORIES = 12, [1, 2, 5]


def made_up(seed: int, crowds: float, ties: bool) -> tuple[TrueBoxes, FoundBoxes]:
    """People of all sizes; found ones near them, twice, elsewhere; scores that repeat if ties."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 60))
    corner, size = rng.uniform(0, 400, (count, 2)), np.exp(rng.uniform(1.5, 5.5, (count, 2)))
    true = true_boxes(
        rng.integers(0, IMAGES, count), rng.choice(CATEGORIES, count), np.hstack([corner, size]),
        size.prod(axis=1) * rng.uniform(0.5, 1.0, count), rng.random(count) < crowds,
    )  # fmt: skip
    chosen = rng.integers(0, count, int(rng.integers(0, 3 * count + 1)))
    box = true.bbox[chosen] * rng.uniform(0.8, 1.25, (len(chosen), 4))
    score = rng.random(len(chosen))
    elsewhere = rng.random(len(chosen)) < 0.2
    return true, found_boxes(
        np.where(elsewhere, rng.integers(0, IMAGES, len(chosen)), true.image[chosen]),
        np.where(elsewhere, rng.choice(CATEGORIES, len(chosen)), true.category[chosen]),
        box,
        score.round(1) if ties else score,
    )


def authors(true: TrueBoxes, found: FoundBoxes) -> list[float]:
    coco = COCO()
    columns = (getattr(true, field).tolist() for field in ("image", "category", "bbox", "area", "crowd"))
    coco.dataset = {
        "info": {},
        "images": [{"id": i} for i in range(IMAGES)],
        "categories": [{"id": c} for c in CATEGORIES],
        "annotations": [
            {"id": k, "image_id": i, "category_id": c, "bbox": b, "area": a, "iscrowd": int(crowd)}
            for k, (i, c, b, a, crowd) in enumerate(zip(*columns, strict=True), 1)
        ],
    }
    rows = zip(*(getattr(found, f).tolist() for f in ("image", "category", "bbox", "score")), strict=True)
    results = [{"image_id": i, "category_id": c, "bbox": b, "score": s} for i, c, b, s in rows]
    with contextlib.redirect_stdout(io.StringIO()):
        coco.createIndex()
        evaluation = COCOeval(coco, coco.loadRes(results), "bbox")
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    return [float("nan") if v < 0 else v for v in evaluation.stats]


@pytest.mark.parametrize("seed", range(40))
def test_every_figure_is_that_of_the_authors_code(seed):
    true, found = made_up(seed, crowds=0.2 * (seed % 2), ties=seed % 4 > 1)
    if not len(found):
        return
    ours = coco_precision(true, found, IMAGES, CATEGORIES).by_size
    p = ours["all"]
    figures = [
        p.ap,
        p.ap50,
        p.ap75,
        *(ours[s].ap for s in ("small", "medium", "large")),
        p.ar1,
        p.ar10,
        p.ar100,
    ]
    figures += [ours[s].ar100 for s in ("small", "medium", "large")]
    np.testing.assert_allclose(figures, authors(true, found), rtol=0, atol=1e-10)


def test_nothing_found_and_nothing_to_find():
    true, _ = made_up(1, 0.0, False)
    nothing = found_boxes([], [], [], [])
    assert coco_precision(true, nothing, IMAGES, CATEGORIES).by_size["all"].ap == 0.0
    nobody = true_boxes([], [], [])
    assert np.isnan(
        coco_precision(nobody, found_boxes([0], [1], [[0, 0, 5, 5]], [0.9]), 3, [1]).by_size["all"].ap
    )
    assert np.isnan(coco_precision(nobody, nothing, 3, [1]).by_size["all"].ap)
    assert np.isnan(optimal_lrp(lrp_curve(match(nobody, nothing), 1)).lrp)

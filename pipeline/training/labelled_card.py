"""The data sheet of a detector that was trained on real pictures."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pipeline.detection import load_detector
from pipeline.training.card import cost
from pipeline.training.config import LabelledPictures, Training
from pipeline.training.labelled_accuracy import (
    LOWEST_SCORE,
    Looked,
    accuracy,
    by_attribute,
    by_size,
    look,
)
from pipeline.training.pictures import PictureSet
from pipeline.training.score_use import ScoreUse, calibration_errors, score_use
from pipeline.training.timing import median_time_s

_TIMED = 100


def write_labelled_card(
    training: Training, model: Path, unseen: Looked, test: PictureSet, today: datetime.date
) -> Path:
    """Measure a trained model on what it has not learned from and write MODEL.card.yaml beside it.

    Threshold and calibration come from unseen, what it (or a network of its recipe) found where it had not
    learned; everything that is reported comes from test.
    """
    data = training.labelled
    assert data is not None  # who calls it has real pictures
    detector = load_detector(model, score_threshold=LOWEST_SCORE)
    use = score_use(unseen, data.split_by)
    usual = load_detector(model, score_threshold=use.threshold)
    median_s = median_time_s(usual, np.asarray(test.clean[test.numbers[0]]), _TIMED)
    clean, degraded = look(detector, test, test.clean), look(detector, test, test.degraded)
    card = {
        "name": training.name,
        "trained": today,
        "purpose": training.purpose,
        "pictures": "real",
        "accuracy": "measured on real pictures that were not learned from",
        "attribution": data.attribution,
        "cost": cost(training, model) | {"milliseconds_one_thread": round(1e3 * median_s, 1)},
        "scores": _scores(data, use, calibration_errors(clean, use), unseen),
        "held_out": {
            "pictures": f"{data.split_by} {_listed(data.test)}: not used for training, threshold or calibration",
            "counted": "people; regions marked as crowds are neither right nor wrong; AP by COCO's rules",
            "degraded_by": "H.264 at 0.1 to 2.5 Mbps and 10 Hz, last picture of a short pan",
            "clean": accuracy(clean, use.threshold),
            "degraded": accuracy(degraded, use.threshold),
            "by": by_attribute(clean, data, use.threshold),
            "by_size_px": by_size(clean, data.sizes),
        },
        "training": training.model_dump(mode="json", exclude_unset=True),
    }
    path = model.with_suffix(".card.yaml")
    path.write_text(yaml.safe_dump(card, sort_keys=False, width=110), encoding="utf-8")
    return path


def _scores(
    data: LabelledPictures, use: ScoreUse, errors: tuple[float, float], unseen: Looked
) -> dict[str, Any]:
    before, after = errors
    return {
        "from": _source(data, len(unseen.attributes)),
        "threshold": use.threshold,
        "rule": use.rule,
        "cross_validated_error_of_each_rule": use.errors or None,
        "calibration": None if use.calibration is None else use.calibration.model_dump(),
        "expected_calibration_error": {
            "of": "the held-out pictures, at the threshold",
            "as_the_network_says": round(before, 3),
            "as_used": round(after, 3),
        },
        "unseen": accuracy(unseen, use.threshold),
    }


def _source(data: LabelledPictures, pictures: int) -> str:
    if data.calibration:
        return f"{pictures} pictures of {data.split_by} {_listed(data.calibration)}, not learned from"
    folds = " and of ".join(_listed(fold) for fold in data.folds)
    return (
        f"{pictures} pictures of {data.split_by} {folds}, seen by networks of this recipe that had not learned "
        "from them"
    )


def _listed(groups: tuple[int | str, ...]) -> str:
    return ", ".join(map(str, groups))

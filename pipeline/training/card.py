"""The data sheet that is shipped beside a detector."""

from __future__ import annotations

import datetime
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
import yaml
from torch.utils.flop_counter import FlopCounterMode

from pipeline.detection import Detector, load_detector
from pipeline.training.accuracy import VISIBLE_MIN, Accuracy, Seen, accuracy, look, people_by_size
from pipeline.training.config import Training
from pipeline.training.network import PersonNetwork
from pipeline.training.pictures import Image, PictureSet
from pipeline.training.timing import median_time_s

#: low enough that the average precision is not cut short
_LOWEST_SCORE = 0.02
_USUAL_SCORE = 0.4
_TIMED = 100


def write_card(
    training: Training, model: Path, mission: PictureSet, sizes: PictureSet, today: datetime.date
) -> Path:
    """Measure a trained model on what it has not learned from and write MODEL.card.yaml beside it."""
    detector = load_detector(model, score_threshold=_LOWEST_SCORE)
    usual = load_detector(model, score_threshold=_USUAL_SCORE)
    median_s = median_time_s(usual, mission.clean[0], _TIMED)
    results = {
        "clean": _rounded(accuracy(_seen(detector, mission, mission.clean))),
        "degraded": _rounded(accuracy(_seen(detector, mission, mission.degraded))),
        "by_size": _by_size(_seen(detector, sizes, sizes.clean)),
    }
    card = {
        "name": training.name,
        "trained": today,
        "purpose": "People in drone video from 6 to 30 m above ground",
        "accuracy": "measured on simulated scenes, not on real video",
        "cost": cost(training, model) | {"milliseconds_one_thread": round(1e3 * median_s, 1)},
        "held_out": _rules() | results,
        "training": training.model_dump(mode="json", exclude_unset=True),
    }
    path = model.with_suffix(".card.yaml")
    path.write_text(yaml.safe_dump(card, sort_keys=False, width=110), encoding="utf-8")
    return path


def _seen(detector: Detector, pictures: PictureSet, images: Image) -> list[Seen]:
    return look(detector, zip(images, pictures.boxes_px, pictures.visible_shares, strict=True))


def _by_size(seen: list[Seen]) -> dict[str, Any]:
    result = asdict(accuracy(seen))
    return {
        size: {"people": count, "ap": round(result[f"ap_{size}"], 3)}
        for size, count in people_by_size(seen).items()
    }


def cost(training: Training, model: Path) -> dict[str, Any]:
    """Of the network, one picture: multiplications and additions, weights, the file's size."""
    network = PersonNetwork(training.network).eval()
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        network(torch.zeros(1, 3, training.input.height, training.input.width))
    return {
        "gigaflop": round(counter.get_total_flops() / 1e9, 3),
        "parameters": sum(p.numel() for p in network.parameters()),
        "megabytes": round(model.stat().st_size / 1e6, 2),
    }


def _rules() -> dict[str, str]:
    return {
        "scenes": "15 m above ground, 45 degrees down; scenes and body models that training never saw",
        "sizes": "of other such scenes, 5 to 22 m above ground; COCO's areas at 1024x576; AP .5:.95",
        "counted": f"people at least {VISIBLE_MIN:.0%} visible; AP by COCO's rules",
        "operating_point": "recall, precision, bottom_edge_px (1024x576): greatest F1, IoU 0.5",
        "degraded_by": "H.264 at 0.1 to 2.5 Mbps and 10 Hz, last picture of a short pan",
    }


def _rounded(result: Accuracy) -> dict[str, float]:
    by_size = ("ap_small", "ap_medium", "ap_large")
    return {key: round(value, 3) for key, value in asdict(result).items() if key not in by_size}

"""Mutated COCO files: read, or refused in one line; nothing else."""

from __future__ import annotations

import json
import random
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from pipeline.config.evaluation import FaultPolicy
from pipeline.errors import InputError
from pipeline.evaluation.datasets.coco import CocoOptions, read_coco
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.evaluation.metrics.score import score_files

#: what a field may hold after all
VALUES = (
    None, True, -1, 0, 1, 3, 1.5, 1e308, -1e400, 1e400, 10**30, 10**400, float("nan"), "", "1", "a.png#1",
    "a.png#²", "\0", "x" * 5000, "../a.png", [], [1], {}, {"id": 1}, [[[]]],
)  # fmt: skip


def truth() -> dict:
    return {
        "images": [
            {"id": k, "file_name": "a.png", "width": 64, "height": 48, "context": {
                "height_m": 20.0, "pitch_deg": -60.0, "focal_px": 900.0}} for k in range(3)
        ],
        "annotations": [
            {"id": k, "image_id": k % 3, "category_id": 1, "bbox": [5, 5, 10, 20], "area": 200, "iscrowd": 0}
            for k in range(6)
        ],
        "categories": [{"id": 1, "name": "person"}],
        "videos": [{"id": 1, "name": "v"}],
    }  # fmt: skip


def results() -> list:
    return [{"image_id": k % 3, "category_id": 1, "bbox": [5, 5, 10, 20], "score": 0.5} for k in range(6)]


def spoiled(content, rng: random.Random):
    """One or a few places of a JSON value changed, left out or doubled."""
    content = json.loads(json.dumps(content))
    for _ in range(rng.choice((1, 1, 2, 4))):
        at = content
        while True:
            keys = list(at) if isinstance(at, dict) else list(range(len(at)))
            if not keys:
                break
            key = rng.choice(keys)
            if isinstance(at[key], dict | list) and at[key] and rng.random() < 0.8:
                at = at[key]
                continue
            kind = rng.random()
            if kind < 0.6:
                at[key] = rng.choice(VALUES)
            elif kind < 0.8:
                del at[key]
            elif isinstance(at, list):
                at.append(at[key])
            else:
                at[rng.choice(("id", "name", "bbox", "video_id", "frame_id", "extra"))] = at[key]
            break
    return content


def written(path: Path, content, rng: random.Random) -> Path:
    data = bytearray(json.dumps(content).encode())
    for _ in range(rng.choice((0, 0, 0, 1, 3))):
        place = rng.randrange(len(data))
        data[place : place + rng.randrange(3)] = bytes(rng.randrange(256) for _ in range(rng.randrange(3)))
    if rng.random() < 0.05:
        data = data[: rng.randrange(len(data))]
    path.write_bytes(bytes(data))
    return path


def is_read(seed: int, attempt: Callable[[], object]) -> bool:
    try:
        attempt()
    except InputError as refusal:
        if "\n" in str(refusal):
            raise AssertionError(f"seed {seed}: more than one line: {refusal}") from refusal
        return False
    except Exception as error:
        raise AssertionError(f"seed {seed}: {error!r}") from error
    return True


def sweep(folder: Path, seeds: range) -> int:
    """How many of the files could be read; one that breaks another way than by one line fails the test."""
    from PIL import Image

    Image.new("RGB", (64, 48)).save(folder / "a.png")
    read, longest_s = 0, 0.0
    for seed in seeds:
        rng = random.Random(seed)
        gt = written(folder / "gt.json", spoiled(truth(), rng) if rng.random() < 0.7 else truth(), rng)
        dt = written(folder / "dt.json", spoiled(results(), rng), rng)
        policy = FaultPolicy(**dict.fromkeys(FaultPolicy.model_fields, rng.choice(("refuse", "skip"))))
        options = CocoOptions(folder, ("person",), 0.3, rng.choice((None, 10.0)), False)
        started = time.process_time()
        read += is_read(seed, partial(score_files, gt, dt))
        read += is_read(seed, partial(read_coco, gt, options, FaultLog(policy)))
        longest_s = max(longest_s, time.process_time() - started)
    assert longest_s < 5.0
    return read


def test_thirty_mutated_files_are_read_or_refused_in_one_line(tmp_path):
    assert 5 < sweep(tmp_path, range(30)) < 55


@pytest.mark.slow
def test_five_hundred_mutated_files_are_read_or_refused_in_one_line(tmp_path):
    assert sweep(tmp_path, range(30, 530)) > 100

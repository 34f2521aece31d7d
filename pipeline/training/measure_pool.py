"""``searchlight measure-pool``: a pool file of measured numbers, but for what it says is assumed."""

from __future__ import annotations

import datetime
import os
import platform
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pipeline.config.pool import load_pool
from pipeline.detection import Detector, load_detector
from pipeline.simulation.clips import flight_over_scene
from pipeline.simulation.dataset import CAMERA, LabelledPicture
from pipeline.training.accuracy import Seen, accuracy, best_threshold, look
from pipeline.training.timing import Timing, memory_of, time_detector
from pipeline.video.codec import Decoder, Encoder

#: scenes of their own, used for no training, no card and no mission
_SEED = 930000
_SCENES = 6
_FRAMES = 20
_RATE_HZ = 10.0
_KEYFRAME_INTERVAL = 20
_BITRATES_BPS = (250e3, 500e3, 1e6, 2.5e6, 5e6)
_LOWEST_SCORE = 0.02
_TIMED = 200
#: so slow a computer on board that not everything fits on it
_ONBOARD_FACTOR = 6.0
_MEMORY_MARGIN = 1.25


@dataclass(frozen=True, slots=True)
class Measured:
    """One detector: AP .5 by bitrate in bit/s, its best threshold, seconds per picture, bytes of memory."""

    ap50: dict[float, float]
    score_threshold: float
    timing: Timing
    memory_bytes: int


def measure_pool(
    models: dict[str, Path], out: Path, *, progress: Callable[[str, int, int, str], None]
) -> Path:
    """Measure detectors, by id, on simulated flights and on this machine, and write the pool file out.

    A detector's card is expected as MODEL.card.yaml beside it. Raises InputError for an unusable model.
    """
    clips = []
    for i in range(_SCENES):
        progress("rendering flights", i, _SCENES, "")
        clips.append(list(flight_over_scene(_SEED + i, _FRAMES, _RATE_HZ)))
    measured = {}
    for i, (name, model) in enumerate(models.items()):
        progress("measuring", i, len(models), name)
        measured[name] = _measure(model, clips)
    out.write_text(
        yaml.safe_dump(pool_of(models, measured, out.parent), sort_keys=False, width=110), encoding="utf-8"
    )
    load_pool(out)
    return out


def _measure(model: Path, clips: list[list[LabelledPicture]]) -> Measured:
    searching = load_detector(model, score_threshold=_LOWEST_SCORE)
    seen = {bitrate: _seen_at(searching, clips, bitrate) for bitrate in _BITRATES_BPS}
    threshold = round(best_threshold([s for at in seen.values() for s in at]), 2)
    return Measured(
        {bitrate: accuracy(at).ap50 for bitrate, at in seen.items()},
        threshold,
        time_detector(load_detector(model, score_threshold=threshold), clips[0][0].image, _TIMED),
        memory_of(model, (CAMERA.width, CAMERA.height)),
    )


def _seen_at(detector: Detector, clips: list[list[LabelledPicture]], bitrate_bps: float) -> list[Seen]:
    """What is found in what is left of the clips after the codec at this bitrate."""
    seen = []
    for clip in clips:
        encoder = Encoder("h264", CAMERA.width, CAMERA.height, _RATE_HZ, bitrate_bps, _KEYFRAME_INTERVAL)
        decoder = Decoder("h264")
        received = (decoder.decode(encoder.encode(p.image, i).data) for i, p in enumerate(clip))
        seen += look(
            detector, ((image, p.boxes_px, p.visible_shares) for image, p in zip(received, clip, strict=True))
        )
    return seen


def pool_of(models: dict[str, Path], measured: dict[str, Measured], folder: Path) -> dict[str, Any]:
    """The pool file's content; folder: where it will lie."""
    return {
        "provenance": {
            "accuracy": f"AP .5, {_SCENES} simulated flights of {_FRAMES} pictures at {_RATE_HZ:g} Hz, H.264",
            "scenes": f"seeds {_SEED} to {_SEED + _SCENES - 1}, 15 m above ground, 45 degrees down, 3 m/s",
            "workstation": f"one thread of {_processor()}, processor time from pixels to boxes; "
            f"maximum: of 99 % of {_TIMED} runs",
            "score_threshold": "where F1 is greatest, over all bitrates",
            "memory": f"growth of a fresh process, times {_MEMORY_MARGIN:g}",
            "date": str(datetime.date.today()),
            "command": "searchlight measure-pool",
        },
        "assumed": [
            f"machine type onboard: {_ONBOARD_FACTOR:g} times as slow as the workstation that was measured"
        ],
        "detectors": [_detector(name, models[name], m, folder) for name, m in measured.items()],
    }


def _detector(name: str, model: Path, measured: Measured, folder: Path) -> dict[str, Any]:
    return {
        "id": name,
        "model": os.path.relpath(model, folder),
        "card": os.path.relpath(model.with_suffix(".card.yaml"), folder),
        "memory": {"megabytes": int(np.ceil(measured.memory_bytes * _MEMORY_MARGIN / 1e6))},
        "score_threshold": measured.score_threshold,
        "accuracy": [
            {"bitrate": {"kbps": bitrate / 1e3}, "accuracy": round(ap50, 3)}
            for bitrate, ap50 in measured.ap50.items()
        ],
        "times": [
            _time("workstation", measured.timing, 1.0),
            _time("onboard", measured.timing, _ONBOARD_FACTOR),
        ],
    }


def _time(machine: str, timing: Timing, factor: float) -> dict[str, Any]:
    mean, maximum = (round(1e3 * factor * t, 2) for t in (timing.mean_s, timing.p99_s))
    return {"machine": machine, "mean": {"milliseconds": mean}, "maximum": {"milliseconds": maximum}}


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()

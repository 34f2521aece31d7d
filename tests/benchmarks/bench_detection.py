"""What it costs to prepare a picture and to read the outputs, beside the bare session; one thread.

python tests/benchmarks/bench_detection.py [MODEL ..]     # by default the shipped ones and those of ../shared
python tests/benchmarks/bench_detection.py --accuracy     # AP with the quick resize and with the exact one
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from pipeline.detection import Detector, load_detector, placement
from pipeline.detection import resize as resize_module

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared" / "data" / "detectors"
SIZES = {"1080p": (1080, 1920), "4K": (2160, 3840)}
RUNS = 25


def medians_ms(detector: Detector, image: np.ndarray) -> tuple[float, float]:
    """The bare session, and everything else of a picture: median milliseconds of processor time."""
    bare: list[float] = []
    run = detector._session.run

    def timed(inputs):
        started = time.thread_time()
        outputs = run(inputs)
        bare.append(time.thread_time() - started)
        return outputs

    detector._session.run = timed
    whole = []
    for _ in range(RUNS):
        started = time.thread_time()
        detector.detect(image)
        whole.append(time.thread_time() - started - bare[-1])
    detector._session.run = run
    return 1e3 * float(np.median(bare[3:])), 1e3 * float(np.median(whole[3:]))


def costs(models: list[Path]) -> None:
    rng = np.random.default_rng(0)
    images = {name: rng.integers(0, 256, (*size, 3), dtype=np.uint8) for name, size in SIZES.items()}
    print(f"{'model':28} {'picture':>8} {'session':>9} {'the rest':>9} {'share':>6}  asked")
    for model in models:
        detector = load_detector(model, score_threshold=0.35)
        for name, image in images.items():
            bare, rest = medians_ms(detector, image)
            if bare > 10.0:
                kept = "" if name != "1080p" else ("15 %" if rest <= 0.15 * bare else "15 %: MISSED")
            else:
                limit = 1.5 if name == "1080p" else 3.0
                kept = f"{limit} ms" if rest <= limit else f"{limit} ms: MISSED"
            print(f"{model.name:28} {name:>8} {bare:7.2f}ms {rest:7.2f}ms {rest / bare:6.1%}  {kept}")


def accuracy() -> None:
    """On simulated pictures of scenes that no training saw, enlarged so that much is left out."""
    from pipeline.simulation.dataset import MISSION_VIEWS, pictures_of_scene
    from pipeline.training.accuracy import accuracy as accuracy_of
    from pipeline.training.accuracy import look

    pictures = [
        p for scene in (940000, 940001) for p in pictures_of_scene(scene, "mission", 15, MISSION_VIEWS)
    ]
    for name in ("nano", "small", "medium"):
        detector = load_detector(ROOT / "configs" / "detectors" / f"{name}.onnx", score_threshold=0.01)
        for grown in (1, 2, 4):
            rows = [
                (np.repeat(np.repeat(p.image, grown, 0), grown, 1), p.boxes_px * grown, p.visible_shares)
                for p in pictures
            ]
            found = []
            for method in (resize_module.resize, exact):
                placement.resize = method
                found.append(accuracy_of(look(detector, rows)).ap50)
            width, height = 1024 * grown, 576 * grown
            print(f"{name} on {width} x {height}: AP .5 {found[0]:.4f}, exact {found[1]:.4f}")


def exact(image: np.ndarray, width: int, height: int, method: str = "area") -> np.ndarray:
    """The same filter with every pixel, in float64."""
    rows = resize_module._FILTERS[method](image.shape[0], height)
    columns = resize_module._FILTERS[method](image.shape[1], width)
    rows, columns = (w / w.sum(axis=1, keepdims=True) for w in (rows, columns))
    planes = [rows @ image[..., c].astype(np.float64) @ columns.T for c in range(3)]
    return (np.stack(planes, axis=2) + 0.5).astype(np.uint8)


if __name__ == "__main__":
    if "--accuracy" in sys.argv:
        accuracy()
    else:
        given = [Path(a) for a in sys.argv[1:]]
        costs(
            given
            or [*sorted((ROOT / "configs" / "detectors").glob("*.onnx")), *sorted(SHARED.glob("*.onnx"))]
        )

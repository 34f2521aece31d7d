"""Small people in 4K pictures: a network on tiles, on the whole frame, and on the pictures at their own size.

Labelled pictures are laid side by side into frames of 3840 x 2160, shifted by half a tile, so that people lie
on seams. AP .5 of

- own size: the network on each picture by itself,
- laid out: the same boxes moved to the pictures' places in the frames, so without a seam, but under COCO's limit
  of 100 boxes for each frame as the tiles are: what seams cost is against it,
- frame: the network on the whole frame,
- tiles: the network on tiles as large as one picture, with the stated overlap.

python tests/benchmarks/bench_tiles.py --simulated 105 [--model A.onnx B.onnx]   # pictures rendered here
python tests/benchmarks/bench_tiles.py --labels COCO.json --pictures DIR --model MODEL.onnx [--most 200]
"""

from __future__ import annotations

import argparse
import resource
import time
from pathlib import Path

import numpy as np

from pipeline.config.evaluation import FaultPolicy
from pipeline.detection import load_detector
from pipeline.detection.nms import iou
from pipeline.detection.picture_file import read_picture
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.evaluation.labelled import labelled_pictures
from pipeline.sensor.setup import Tiling
from pipeline.training.accuracy import VISIBLE_MIN, Seen, accuracy, look

ROOT = Path(__file__).resolve().parents[2]
WIDTH, HEIGHT = 3840, 2160
OVERLAP = 0.25
Row = tuple[np.ndarray, np.ndarray, np.ndarray]


def simulated(count: int) -> list[Row]:
    """Pictures of scenes that no training saw, from 15 m: people of 20 to 60 pixels."""
    from pipeline.simulation.dataset import MISSION_VIEWS, pictures_of_scene

    rows: list[Row] = []
    for scene in range(940000, 940000 + -(-count // 15)):
        rows += [
            (np.asarray(p.image), p.boxes_px, p.visible_shares)
            for p in pictures_of_scene(scene, "mission", 15, MISSION_VIEWS)
        ]
    return rows[:count]


def labelled(labels: Path, folder: Path, most: int) -> list[Row]:
    """Pictures with COCO labels; those with people first, evenly from all."""
    dataset = labelled_pictures(labels, folder, FaultLog(FaultPolicy(outside_box="skip")))
    rows = []
    for sequence in dataset.sequences:
        for n in sequence.pictures:
            mine = dataset.truth.image == n
            if mine.any():
                box = dataset.truth.bbox[mine]
                xyxy = np.concatenate([box[:, :2], box[:, :2] + box[:, 2:]], axis=1)
                seen = np.where(dataset.truth.crowd[mine], 0.0, 1.0)
                rows.append((sequence.files[dataset.pictures[n].frame], xyxy, seen))
    chosen = rows[:: max(1, len(rows) // most)][:most]
    return [(read_picture(file), boxes, seen) for file, boxes, seen in chosen]


def places(wide: int, high: int) -> list[tuple[int, int]]:
    """Where in a frame pictures lie: half a tile to the right and down, side by side."""
    left, top = wide // 2, high // 2
    columns, lines = (WIDTH - left) // wide, (HEIGHT - top) // high
    return [(left + column * wide, top + line * high) for line in range(lines) for column in range(columns)]


def mosaics(rows: list[Row]) -> list[Row]:
    """Frames of WIDTH x HEIGHT with the pictures in their places, the rest grey."""
    high, wide = rows[0][0].shape[:2]
    spots = places(wide, high)
    frames = []
    for first in range(0, len(rows), len(spots)):
        frame = np.full((HEIGHT, WIDTH, 3), 114, np.uint8)
        boxes, seen = [np.zeros((0, 4))], [np.zeros(0)]
        for (x, y), (image, box, share) in zip(spots, rows[first : first + len(spots)], strict=False):
            frame[y : y + high, x : x + wide] = image
            boxes.append(box + np.array([x, y, x, y]))
            seen.append(share)
        frames.append((frame, np.concatenate(boxes), np.concatenate(seen)))
    return frames


def near_a_seam(frames: list[Row], detector) -> float:
    """Share of the people whose box lies within a box's size of an edge of a tile that is none of the frame."""
    from pipeline.detection.tiles import windows_of

    windows = windows_of(WIDTH, HEIGHT, detector.setup.tiling)
    xs = {v for v in windows[:, [0, 2]].ravel().tolist() if 0 < v < WIDTH}
    ys = {v for v in windows[:, [1, 3]].ravel().tolist() if 0 < v < HEIGHT}
    near = total = 0
    for _, boxes, _ in frames:
        for x0, y0, x1, y1 in boxes:
            w, h = x1 - x0, y1 - y0
            total += 1
            near += any(x0 - w <= x <= x1 + w for x in xs) or any(y0 - h <= y <= y1 + h for y in ys)
    return near / max(total, 1)


def laid_out(seen: list[Seen]) -> list[Seen]:
    """What was found in pictures by themselves, in the frames of their mosaics."""
    spots = places(*seen[0].size)
    frames = []
    for first in range(0, len(seen), len(spots)):
        some = [
            (s, np.array([x, y, x, y], float))
            for (x, y), s in zip(spots, seen[first : first + len(spots)], strict=False)
        ]
        frames.append(
            Seen(
                (WIDTH, HEIGHT),
                np.concatenate([s.true + at for s, at in some]),
                np.concatenate([s.visible for s, _ in some]),
                np.concatenate([s.found + at for s, at in some]),
                np.concatenate([s.scores for s, _ in some]),
            )
        )
    return frames


def ap(detector, frames: list[Row]) -> float:
    return accuracy(look(detector, frames)).ap50


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--model", type=Path, nargs="+", default=[ROOT / "configs" / "detectors" / "small.onnx"]
    )
    parser.add_argument("--simulated", type=int, default=0)
    parser.add_argument("--labels", type=Path)
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--most", type=int, default=200)
    given = parser.parse_args()
    rows = (
        simulated(given.simulated) if given.simulated else labelled(given.labels, given.pictures, given.most)
    )
    shifted = mosaics(rows)
    for model in given.model:
        compare(model, rows, shifted)
    print(f"peak memory of this process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


def compare(model: Path, rows: list[Row], shifted: list[Row]) -> None:
    """One network at own size, on tiles, on the frame."""
    high, wide = rows[0][0].shape[:2]
    tiling = Tiling(wide, high, OVERLAP, False)
    plain = load_detector(model, score_threshold=0.01)
    tiled = load_detector(model, score_threshold=0.01, tiling=tiling)
    alone = look(plain, rows)
    own, laid = accuracy(alone).ap50, accuracy(laid_out(alone)).ap50
    on_tiles, on_frame = ap(tiled, shifted), ap(plain, shifted)
    people = sum(int((seen >= VISIBLE_MIN).sum()) for _, _, seen in rows)
    print(
        f"{model.name}, {len(rows)} pictures of {wide} x {high} with {people} people,"
        f" {len(shifted)} frames of {WIDTH} x {HEIGHT}"
    )
    print(f"people within a box of a seam: {near_a_seam(shifted, tiled):.0%}")
    print(
        f"AP .5: own size {own:.3f}, laid out {laid:.3f}, tiles {on_tiles:.3f}"
        f" ({on_tiles / max(own, 1e-9):.2f} of own size), frame {on_frame:.3f}"
    )
    print(f"seams cost {laid - on_tiles:+.3f} AP")
    doubled = sum(_doubles(tiled, frame) for frame in shifted)
    print(f"people with two boxes that overlap by more than half of the smaller: {doubled}")
    for name, tiles in (("frame", None), ("tiles", tiling)):
        detector = load_detector(model, score_threshold=0.3, tiling=tiles)
        started = time.thread_time()
        for frame, _, _ in shifted[:3]:
            detector.detect(frame)
        each_ms = 1e3 * (time.thread_time() - started) / min(3, len(shifted))
        print(f"{name}: {each_ms:.0f} ms of a thread per 4K frame")


def _doubles(detector, row: Row) -> int:
    """True people that two boxes of a score of 0.3 and more each fit by half."""
    frame, true, seen = row
    boxes, scores, _ = detector.detect(frame)
    boxes = boxes[scores >= 0.3]
    return sum(int((iou(box, boxes) > 0.5).sum() > 1) for box in true[seen > 0.3])


if __name__ == "__main__":
    main()

"""Where the time of an evaluation goes: the paper's grid, 4 codecs at 9 bitrates, on five minutes of video.

python tests/benchmarks/bench_evaluation_grid.py FOLDER
python tests/benchmarks/bench_evaluation_grid.py --results DIR/results.json   # of an evaluation that is there

The video is the flights of configs/evaluations/codecs.yaml, rendered as its first lines say, one after the
other and again. Twice: one detector from nothing, and another from the streams that were kept. The first took
an hour and a half on two cores that did other work too; interrupted, it goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import yaml

from pipeline.config.evaluation import load_evaluation
from pipeline.evaluation.datasets.dataset import DataSet
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.evaluation.datasets.read_datasets import read_datasets
from pipeline.evaluation.report.results import load_results
from pipeline.ingest.video.file import decoded_frames

ROOT = Path(__file__).resolve().parents[2]
CODECS = ROOT / "configs/evaluations/codecs.yaml"
ENDINGS = {"model": "onnx", "card": "card.yaml"}
FIVE_MINUTES = 9000  # frames at 30 Hz


def profile(results: Path) -> None:
    """Where the time of an evaluation went."""
    p = load_results(results).provenance
    for name, seconds in (("all cells", p.seconds), ("this run", p.seconds_this_run)):
        total = sum(seconds.values()) or 1.0
        parts = sorted(seconds.items(), key=lambda item: -item[1])
        print(f"{name}, {total:.0f} s: " + ", ".join(f"{part} {s / total:.1%}" for part, s in parts))
        known = {"source", "encode", "decode", "detect"}
        rest = sum(s for part, s in seconds.items() if part not in known)
        print(f"  all but source, encode, decode and detect: {rest / total:.1%}")


def five_minutes(dataset: DataSet, folder: Path) -> None:
    """flights.mp4 and flights.json (COCO) in a folder: all flights, again and again, 9000 frames."""
    images: list[dict] = []
    marks: list[dict] = []
    with av.open(str(folder / "flights.mp4"), "w") as video:
        stream = video.add_stream("libx264", 30)
        stream.width, stream.height, stream.pix_fmt = 1024, 576, "yuv420p"
        stream.options = {"preset": "veryfast", "crf": "16"}
        for index, (frame, picture) in zip(range(FIVE_MINUTES), _again_and_again(dataset), strict=False):
            frame.pts, frame.time_base, frame.pict_type = index, Fraction(1, 30), 0
            for packet in stream.encode(frame):
                video.mux(packet)
            if picture is None:
                continue
            images.append({"id": index, "file_name": f"flights.mp4#{index}", "width": 1024, "height": 576})
            for k in (dataset.truth.image == picture).nonzero()[0]:
                bbox, area = dataset.truth.bbox[k].tolist(), float(dataset.truth.area[k])
                crowd = int(dataset.truth.crowd[k])
                mark = {"id": len(marks) + 1, "image_id": index, "category_id": 1}
                marks.append(mark | {"bbox": bbox, "area": area, "iscrowd": crowd})
        for packet in stream.encode():
            video.mux(packet)
    document = {"images": images, "annotations": marks, "categories": [{"id": 1, "name": "person"}]}
    (folder / "flights.json").write_text(json.dumps(document))


def _again_and_again(dataset: DataSet) -> Iterator[tuple[av.VideoFrame, int | None]]:
    """Frames, and the number of the annotated picture that each is."""
    while True:
        for q in dataset.sequences:
            numbers = {dataset.pictures[n].frame: n for n in q.pictures}
            for k, frame in enumerate(decoded_frames(q.files[0])):
                yield frame, numbers.get(k)


def grid(folder: Path) -> None:
    """Time the whole grid for one detector."""
    evaluation = load_evaluation(CODECS)
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "flights.json").is_file():
        five_minutes(read_datasets(evaluation, FaultLog(evaluation.faults)), folder)
    document = yaml.safe_load(CODECS.read_text())
    document["datasets"] = [
        {"format": "coco", "path": str(folder.resolve() / "flights.json"), "simulated": True}
    ]
    document["transcoding"]["keep_streams"] = True
    del document["timing"]
    for name in ("small", "medium"):
        files = {key: str(ROOT / f"configs/detectors/{name}.{end}") for key, end in ENDINGS.items()}
        document["detectors"] = [{"id": name, **files}]
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(document))
        started = time.perf_counter()
        command = [
            sys.executable,
            "-m",
            "actors.cli",
            "evaluate",
            folder / f"{name}.yaml",
            "--out",
            folder / "out",
        ]
        subprocess.run(command, cwd=ROOT, check=True)
        print(f"{name}: {time.perf_counter() - started:.0f} s by the clock")
        profile(folder / "out/results.json")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--results", type=Path)
    arguments = parser.parse_args()
    if arguments.folder:
        grid(arguments.folder)
    if arguments.results:
        profile(arguments.results)


if __name__ == "__main__":
    main()

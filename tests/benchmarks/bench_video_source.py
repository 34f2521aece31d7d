"""What a 4K video costs before a detector sees it, beside the first reader; and what checking 20 minutes costs.

python tests/benchmarks/bench_video_source.py [--folder DIR] [--seconds 6] [--minutes 20] [--first-reader 1115d69]

The clips are the demo's pictures enlarged to 3840 x 2160, with a camera's noise, at 40 Mbit/s. Both readers decode
each of them, sample it at 10 Hz and encode it for two substreams of 1 Mbit/s each, in processes of their own, by
turns. The mission to check has two streams, each 20 minutes of the H.264 clip, repeated by copying its packets.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import av
import numpy as np
import yaml

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "configs/missions/demo"
SIZE, RATE = (3840, 2160), 30
#: ``searchlight check``, and what it took; VmHWM is its own, ru_maxrss would be that of its parent where that is more
_CHECK = """
import os, pathlib, sys
from actors.cli import main
try:
    main()
except SystemExit as ended:
    if ended.code:
        raise
kilobytes = int(pathlib.Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
print(f"{sum(os.times()[:4]):.1f} {kilobytes * 1024 / 1e6:.0f}")
"""
#: the largest input of the demo's detectors
SENT = (1024, 576)
CODECS = {
    "h264": ("libx264", {"preset": "veryfast", "bf": "0", "g": "30"}),
    "h265": ("libx265", {"preset": "ultrafast", "x265-params": "log-level=none:keyint=30:bframes=0"}),
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--seconds", type=int, default=6)
    parser.add_argument("--minutes", type=int, default=20)
    parser.add_argument("--first-reader", default="1115d69")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--only", choices=("source", "check"))
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure is not None:
        print(json.dumps(measured(arguments.measure)))
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        clips = {name: clip(folder / f"{name}.mp4", name, arguments.seconds) for name in CODECS}
        if arguments.only != "check":
            first = first_reader(folder / "first", arguments.first_reader)
            for name, path in clips.items():
                compare(name, path, {"first": first, "now": ROOT}, arguments.turns)
        if arguments.only != "source":
            check(folder, clips["h264"], 60 * arguments.minutes)


def compare(name: str, path: Path, trees: dict[str, Path], turns: int) -> None:
    """Both readers on one clip, by turns."""
    costs: dict[str, list[dict[str, float]]] = {tree: [] for tree in trees}
    for _ in range(turns):
        for tree, root in trees.items():
            command = [sys.executable, __file__, "--measure", str(path)]
            env = os.environ | {"PYTHONPATH": str(root)}
            told = subprocess.run(command, env=env, check=True, capture_output=True, text=True)
            costs[tree].append(json.loads(told.stdout))
    middle = {
        tree: {key: statistics.median(c[key] for c in of) for key in of[0]} for tree, of in costs.items()
    }
    for tree, cost in middle.items():
        print(
            f"{name} 4K, {tree}: {cost['cpu_s']:.2f} CPU seconds and {cost['wall_s']:.2f} s "
            f"({cost['threads']:.0f} decoding threads) per second of video"
        )
    decode_s = middle["now"]["decode_cpu_s"]
    ratio = middle["first"]["cpu_s"] / middle["now"]["cpu_s"]
    print(
        f"{name} 4K: {ratio:.1f} times the frames per CPU second; decoding alone {decode_s:.2f} CPU seconds"
    )


def measured(path: Path) -> dict[str, float]:
    """Of the reader that PYTHONPATH finds: seconds per second of video."""
    from pipeline.allocation.plan import Assignment
    from pipeline.messages import CameraPose
    from pipeline.mission.stages.source import SourceStage, StreamInput

    pose = CameraPose(np.zeros(3), np.eye(3))
    trajectory = SimpleNamespace(pose=lambda time_s: pose, utc_ns=lambda time_s: round(time_s * 1e9))
    packets: list[object] = []
    link = SimpleNamespace(
        is_up=lambda site, detector: True,
        backlog_s=lambda site, now_s: 0.0,
        send=lambda *message: packets.append(message) or True,
        take_restarts=tuple,
        take_lost=tuple,
    )
    threads = 1
    try:
        from pipeline.ingest.video.recordings import open_recordings
    except ImportError:
        from pipeline.ingest.video.file import open_video

        source = open_video(path)
        seconds = source.duration_s
    else:
        threads = 2
        source = open_recordings([path], threads=threads).resized(*SENT)
        seconds = source.end_s
    stream = StreamInput("v", "drone", source, trajectory, 10.0, "h264")
    assignments = tuple(Assignment("v", d, d, "m", "site", 1, 0, 1e6) for d in ("a", "b"))
    stage = SourceStage(stream, assignments, link)
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    stage.run(lambda video_s: video_s)
    cost = {
        "cpu_s": (time.process_time() - cpu_s) / seconds,
        "wall_s": (time.perf_counter() - wall_s) / seconds,
        "threads": float(threads),
    }
    if len(packets) != 2 * round(10 * seconds) + 2:
        raise SystemExit(f"{len(packets)} packets")
    cpu_s = time.process_time()
    with av.open(str(path)) as container:
        container.streams.video[0].codec_context.thread_count = 1
        for _ in container.decode(video=0):
            pass
    return cost | {"decode_cpu_s": (time.process_time() - cpu_s) / seconds}


def check(folder: Path, path: Path, seconds: int) -> None:
    """Time and memory of ``searchlight check`` of a mission of two long videos."""
    mission = folder / "mission/mission.yaml"
    if not mission.is_file():
        long_mission(mission.parent, path, seconds)
    started = time.perf_counter()
    told = subprocess.run(
        [sys.executable, "-c", _CHECK, "check", str(mission)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    wall_s = time.perf_counter() - started
    cpu_s, peak_mb = told.stdout.split()[-2:]
    print(
        f"check of two streams of {seconds / 60:.0f} minutes of 4K: {wall_s:.1f} s ({cpu_s} CPU s), {peak_mb} MB"
    )


def clip(path: Path, name: str, seconds: int) -> Path:
    """The demo's first pictures, enlarged and encoded."""
    if path.is_file():
        return path
    codec, options = CODECS[name]
    # enlarging has smoothed it away; chroma is left as it is
    noise = np.random.default_rng(0).normal(0.0, 2.0, (SIZE[1] * 3 // 2, SIZE[0])).round().astype(np.int16)
    noise[SIZE[1] :] = 0
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=RATE, options=options)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        stream.bit_rate = 40_000_000
        for index, frame in enumerate(_demo_frames(seconds * RATE)):
            planes = frame.reformat(*SIZE, format="yuv420p", interpolation="BICUBIC").to_ndarray()
            noisy = np.clip(planes + np.roll(noise, 977 * index, axis=1), 16, 235).astype(np.uint8)
            large = av.VideoFrame.from_ndarray(noisy, format="yuv420p")
            large.pts, large.time_base = index, Fraction(1, RATE)
            container.mux(stream.encode(large))
        container.mux(stream.encode(None))
    return path


def first_reader(folder: Path, commit: str) -> Path:
    """The tree of a commit."""
    if not folder.is_dir():
        folder.mkdir()
        archive = subprocess.run(
            ["git", "archive", commit, "pipeline"], cwd=ROOT, check=True, capture_output=True
        )
        subprocess.run(["tar", "-x", "-C", str(folder)], input=archive.stdout, check=True)
    return folder


def long_mission(folder: Path, path: Path, seconds: int) -> Path:
    """The demo with one long 4K video for both drones; as often as the clip, its telemetry begins anew."""
    with av.open(str(path)) as container:
        clip_seconds = container.streams.video[0].frames // RATE
    shutil.copytree(DEMO, folder, dirs_exist_ok=True)
    repeated(path, folder / "drone-1.mp4", seconds)
    shutil.copyfile(folder / "drone-1.mp4", folder / "drone-2.mp4")
    cues = (DEMO / "drone-1.srt").read_text(encoding="utf-8").split("\n\n")[: clip_seconds * RATE]
    moved = (_cue(cues[k % len(cues)], k) for k in range(seconds * RATE))
    (folder / "drone-1.srt").write_text("\n\n".join(moved) + "\n", encoding="utf-8")
    shutil.copyfile(folder / "drone-1.srt", folder / "drone-2.srt")
    camera = yaml.safe_load((DEMO / "camera.yaml").read_text(encoding="utf-8"))
    scale = SIZE[0] / camera["width"]
    camera |= {key: camera[key] * scale for key in ("fx", "fy", "cx", "cy")}
    camera |= {"width": SIZE[0], "height": SIZE[1]}
    (folder / "camera.yaml").write_text(yaml.safe_dump(camera), encoding="utf-8")
    mission = folder / "mission.yaml"
    text = mission.read_text(encoding="utf-8").replace("../../", f"{ROOT}/configs/")
    mission.write_text(text, encoding="utf-8")
    return mission


def repeated(path: Path, out: Path, seconds: int) -> None:
    """A clip's packets again and again, until it is so long."""
    if out.is_file() and out.stat().st_size > 50 * path.stat().st_size:
        return
    with av.open(str(path)) as old, av.open(str(out), "w") as new:
        template = old.streams.video[0]
        stream = new.add_stream_from_template(template)
        kept = [(bytes(p), p.pts, p.dts, p.is_keyframe) for p in old.demux(template) if p.size]
        step = round(1 / RATE / template.time_base)
        for round_ in range(-(-seconds * RATE // len(kept))):
            shift = round_ * len(kept) * step
            for data, pts, dts, is_keyframe in kept[: seconds * RATE - round_ * len(kept)]:
                packet = av.Packet(data)
                packet.pts, packet.dts, packet.time_base = pts + shift, dts + shift, template.time_base
                packet.is_keyframe, packet.stream = is_keyframe, stream
                new.mux(packet)


def _demo_frames(count: int) -> Iterator[av.VideoFrame]:
    with av.open(str(DEMO / "drone-1.mp4")) as container:
        for index, frame in enumerate(container.decode(video=0)):
            if index == count:
                return
            yield frame


def _cue(cue: str, index: int) -> str:
    """A cue of the demo as the one of a later picture."""
    _, _, *text = cue.strip().splitlines()
    date = f"2026-06-14 {_date(index / RATE)}"
    lines = [date if line.startswith("2026-") else line for line in text]
    return "\n".join([str(index + 1), f"{_clock(index / RATE)} --> {_clock((index + 1) / RATE)}", *lines])


def _clock(time_s: float) -> str:
    ms = round(time_s * 1000)
    return f"{ms // 3_600_000:02}:{ms // 60_000 % 60:02}:{ms // 1000 % 60:02},{ms % 1000:03}"


def _date(time_s: float) -> str:
    us = round(time_s * 1e6)
    minutes = 30 + us // 60_000_000
    return f"{9 + minutes // 60:02}:{minutes % 60:02}:{us // 1_000_000 % 60:02},{us // 1000 % 1000:03},{us % 1000:03}"


if __name__ == "__main__":
    main()

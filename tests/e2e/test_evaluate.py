"""``searchlight evaluate`` and its companions as a user runs them."""

from __future__ import annotations

import csv
import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import av
import pytest
import yaml

from actors.cli import main
from pipeline.config.pool import load_pool

ROOT = Path(__file__).resolve().parents[2]
REAL = ROOT.parent / "shared/data/evaluation"


def searchlight(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["searchlight", *map(str, arguments)])
    try:
        main()
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def evaluation(folder: Path, mission: Path, **changes: object) -> Path:
    document = {
        "name": "e2e",
        "datasets": [{"format": "mission", "path": str(mission)}],
        "detectors": [{"id": "small", "model": str(ROOT / "configs/detectors/small.onnx")}],
        "transcoding": {"codecs": ["h264"], "bitrates": [{"kbps": 100}], "width": 512, "height": 288},
        "timing": {"setups": [{"machine": "workstation"}], "pictures": 10, "warm_up": 1},
        "bootstrap": {"replicates": 20, "block": {"seconds": 1}},
    } | changes
    path = folder / "evaluation.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


@pytest.mark.slow
def test_from_an_evaluation_file_to_pool_tables_and_report(small_mission, tmp_path, monkeypatch, capsys):
    file, out = evaluation(tmp_path, small_mission), tmp_path / "out"
    assert searchlight(monkeypatch, "evaluate", file, "--out", out, "--workers", 1) == 0
    (detector,) = load_pool(out / "pool.yaml").detectors
    assert detector.model.resolve() == (ROOT / "configs/detectors/small.onnx").resolve()
    assert detector.accuracy[0].bitrate == 100e3
    assert 0.2 < detector.accuracy[0].accuracy <= 1.0
    (point,) = detector.operating_points
    assert (point.codec, point.bitrate, point.picture_width) == ("h264", 100e3, 512)
    assert all(0.0 <= row.share <= 1.0 and row.people >= 10 for row in point.found)
    assert any(row.share > 0.2 for row in point.found)
    rows = list(csv.DictReader((out / "cells.csv").open()))
    assert {row["codec"] for row in rows} == {"source", "h264"}
    assert "simulated-scene accuracy" in (out / "report.html").read_text()
    assert not list(out.rglob("*.part"))
    kept = {p: p.stat().st_mtime_ns for p in (out / "cache").rglob("*") if p.is_file()}
    assert len(kept) == 4 + 2 + 1  # detections of two sequences, as filmed and transcoded; streams; times

    # again: nothing is worked out anew, and the figures are the same
    before = json.loads((out / "results.json").read_text())["cells"]
    assert searchlight(monkeypatch, "evaluate", file, "--out", out, "--workers", 1) == 0
    assert {p: p.stat().st_mtime_ns for p in (out / "cache").rglob("*") if p.is_file()} == kept
    assert json.loads((out / "results.json").read_text())["cells"] == before
    capsys.readouterr()

    assert searchlight(monkeypatch, "pool", "show", out / "pool.yaml") == 0
    assert "small" in capsys.readouterr().out
    assert searchlight(monkeypatch, "pool", "diff", out / "pool.yaml", out / "pool.yaml") == 0
    assert searchlight(monkeypatch, "pool", "diff", out / "pool.yaml", ROOT / "configs/pools/demo.yaml") == 1
    assert "accuracy at 100 kbps" in capsys.readouterr().out
    merged = tmp_path / "merged.yaml"
    other = ROOT / "configs/pools/paper.yaml"
    assert searchlight(monkeypatch, "pool", "merge", out / "pool.yaml", other, "--out", merged) == 0
    assert len(load_pool(merged).detectors) == 1 + len(load_pool(other).detectors)
    carried, slower = (
        tmp_path / "carried.yaml",
        ("--machine", "onboard", "--like", "workstation", "--slower", 6),
    )
    assert searchlight(monkeypatch, "pool", "assume", out / "pool.yaml", *slower, "--out", carried) == 0
    assert [t.machine for t in load_pool(carried).detectors[0].times] == ["workstation", "onboard"]
    assert searchlight(monkeypatch, "pool", "assume", out / "pool.yaml", *slower, "--out", carried) == 2
    assert "carried.yaml: found a file that is there already" in capsys.readouterr().err.replace("\n", "")


def stills_of(mission: Path, folder: Path) -> Path:
    """Every fifteenth frame of the mission's videos as a PNG, with its boxes; the COCO file."""
    images, marks = [], []
    for boxes in sorted((mission.parent / "truth").glob("boxes-*.json")):
        document = json.loads(boxes.read_text())
        wanted = {int(i["file_name"].partition("#")[2]): i for i in document["images"]}
        video = mission.parent / document["images"][0]["file_name"].partition("#")[0]
        with av.open(str(video)) as container:
            for index, frame in enumerate(container.decode(video=0)):
                if index % 15 or index not in wanted:
                    continue
                name = f"{video.stem}-{index}"
                frame.to_image().save(folder / f"{name}.png")
                images.append(wanted[index] | {"id": name, "file_name": f"{name}.png"})
                marks += [
                    a | {"id": f"{name}-{a['id']}", "image_id": name}
                    for a in document["annotations"]
                    if a["image_id"] == wanted[index]["id"]
                ]
    path = folder / "stills.json"
    categories = [{"id": 1, "name": "person"}]
    path.write_text(json.dumps({"images": images, "annotations": marks, "categories": categories}))
    return path


def test_stills_give_a_pool_that_says_what_it_takes_for_granted(small_mission, tmp_path, monkeypatch, capsys):
    labels, out = stills_of(small_mission, tmp_path), tmp_path / "out"
    file = evaluation(tmp_path, labels, datasets=[{"format": "coco", "path": str(labels)}])
    document = yaml.safe_load(file.read_text())
    del document["transcoding"]
    file.write_text(yaml.safe_dump(document))
    assert searchlight(monkeypatch, "evaluate", file, "--out", out, "--workers", 1) == 0
    pool = load_pool(out / "pool.yaml")
    (detector,) = pool.detectors
    results = json.loads((out / "results.json").read_text())
    (cell,) = results["cells"]
    assert cell["codec"] is None
    assert detector.accuracy[0].accuracy == pytest.approx(cell["by_size"]["all"]["ap50"], abs=1e-4)
    assert 0.2 < detector.accuracy[0].accuracy <= 1.0
    assert {row.size for row in detector.accuracy_by_size} <= {"small", "medium", "large"}
    assert detector.times[0].machine == "workstation"
    assert "not of encoded video" in detector.assumed
    assert pool.assumed == (f"small: {detector.assumed}",)
    assert "of pictures as they are" in pool.provenance["accuracy"]


@pytest.fixture
def copied(small_mission, tmp_path):
    """A mission that may be spoilt."""
    shutil.copytree(small_mission.parent, tmp_path / "mission")
    return tmp_path / "mission" / "mission.yaml"


def spoil_boxes(mission: Path, change) -> None:
    path = mission.parent / "truth/boxes-drone-1.json"
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def truncated(mission: Path) -> None:
    video = mission.parent / "drone-1.mp4"
    video.write_bytes(video.read_bytes()[:2000])


BAD = {
    "no truth": (lambda m: shutil.rmtree(m.parent / "truth"), {}, "truth: found no boxes-STREAM.json"),
    "unknown picture": (
        lambda m: spoil_boxes(m, lambda d: d["annotations"][0].update(image_id=99999)),
        {},
        "boxes-drone-1.json annotations.id=1.image_id: found 99999, no listed picture",
    ),
    "box outside": (
        lambda m: spoil_boxes(m, lambda d: d["annotations"][0].update(bbox=[500, 0, 50, 50])),
        {},
        "boxes-drone-1.json annotations.id=1.bbox",
    ),
    "id twice": (lambda m: spoil_boxes(m, lambda d: d["images"].append(d["images"][0])), {}, "found 0 again"),
    "other frame count": (
        lambda m: spoil_boxes(m, lambda d: d["images"].pop()),
        {},
        "images of drone-1: found annotations up to frame",
    ),
    "truncated video": (truncated, {}, "drone-1.mp4"),
    "no model": (
        lambda _: None,
        {"detectors": [{"id": "a", "model": "absent.onnx"}]},
        "absent.onnx: found no file",
    ),
    "no detector": (
        lambda _: None,
        {"detectors": [{"id": "a", "model": str(ROOT / "tests/data/identity.onnx")}]},
        "no input that can be a picture",
    ),
    "other aspect": (
        lambda _: None,
        {"transcoding": {"codecs": ["h264"], "bitrates": [{"kbps": 100}], "width": 512, "height": 512}},
        "the aspect of transcoding.width, height",
    ),
    "no provider": (
        lambda _: None,
        {"timing": {"setups": [{"machine": "m", "provider": "abacus"}]}},
        "provider 'abacus'",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_each_thing_that_is_wrong_is_one_line_and_leaves_no_report(
    copied, tmp_path, monkeypatch, capsys, name
):
    spoil, changes, message = BAD[name]
    spoil(copied)
    file = evaluation(tmp_path, copied, **changes)
    assert searchlight(monkeypatch, "evaluate", file, "--out", tmp_path / "out", "--workers", 1) == 2
    errors = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert message in errors[0]
    assert not (tmp_path / "out" / "report.html").exists()
    assert not (tmp_path / "out" / "pool.yaml").exists()


def test_a_folder_of_others_is_left_alone(small_mission, tmp_path, monkeypatch, capsys):
    out = tmp_path / "mine"
    out.mkdir()
    (out / "letter.txt").write_text("dear")
    file = evaluation(tmp_path, small_mission)
    assert searchlight(monkeypatch, "evaluate", file, "--out", out) == 2
    assert "a folder with other files" in capsys.readouterr().err
    assert [p.name for p in out.iterdir()] == ["letter.txt"]


@pytest.mark.slow
def test_an_interrupted_evaluation_says_how_it_goes_on(small_mission, tmp_path, monkeypatch, capsys):
    def interrupted(units):
        raise KeyboardInterrupt

    monkeypatch.setattr("pipeline.evaluation.measuring.grid.work", interrupted)
    file = evaluation(tmp_path, small_mission)
    document = yaml.safe_load(file.read_text())
    del document["timing"]
    file.write_text(yaml.safe_dump(document))
    out = tmp_path / "out"
    assert searchlight(monkeypatch, "evaluate", file, "--out", out, "--workers", 1) == 130
    assert "the same command goes on" in capsys.readouterr().err
    monkeypatch.undo()
    assert searchlight(monkeypatch, "evaluate", file, "--out", out, "--workers", 1) == 0
    assert "no pool: it needs timing" in capsys.readouterr().err


def children(pid: int) -> list[int]:
    processes = (int(folder.name) for folder in Path("/proc").glob("[0-9]*"))
    return [process for process in processes if parent_of(process) == pid]


def parent_of(pid: int) -> int | None:
    try:
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    except OSError:
        return None


@pytest.mark.slow
def test_a_real_interrupt_keeps_what_is_finished_and_a_second_run_at_once_is_refused(small_mission, tmp_path):
    bitrates = [{"kbps": 100 * k} for k in range(1, 7)]
    transcoding = {"codecs": ["h264", "vp9"], "bitrates": bitrates, "width": 512, "height": 288}
    file, out = evaluation(tmp_path, small_mission, transcoding=transcoding), tmp_path / "out"
    document = yaml.safe_load(file.read_text())
    del document["timing"]
    file.write_text(yaml.safe_dump(document))
    command = [sys.executable, "-m", "actors.cli", "evaluate", str(file), "--out", str(out), "--workers", "2"]
    run = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 200
    while len(list(out.glob("cache/found/*.npz"))) < 3:
        assert time.monotonic() < deadline
        assert run.poll() is None
        time.sleep(0.2)
    second = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert second.returncode == 2
    assert "another evaluation at work in it" in second.stderr
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 130, said
    assert "the same command goes on" in said
    assert "Traceback" not in said
    before = {p: p.stat().st_mtime_ns for p in out.glob("cache/found/*.npz")}
    assert len(before) < 26
    killed = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL)
    while not list(out.glob("cache/streams/.*.part")):
        assert killed.poll() is None
        time.sleep(0.05)
    workers = children(killed.pid)
    killed.kill()
    killed.wait()
    deadline = time.monotonic() + 20
    while any(Path(f"/proc/{pid}").exists() for pid in workers):
        assert time.monotonic() < deadline, "a worker outlives its parent"
        time.sleep(0.1)
    last = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert last.returncode == 0, last.stderr
    after = {p: p.stat().st_mtime_ns for p in out.glob("cache/found/*.npz")}
    assert len(after) == 26
    assert all(after[p] == written for p, written in before.items())
    assert not list(out.rglob(".*part"))


@pytest.mark.skipif(not REAL.is_dir(), reason=f"{REAL} is not there")
def test_scores_of_real_detections_are_the_published_ones(monkeypatch, capsys):
    files = REAL / "instances_val.json", REAL / "result_all_classes.json"
    assert searchlight(monkeypatch, "score", *files) == 0
    mean = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("mean"))
    assert mean.split()[2:4] == ["0.3916125251", "0.6138249650"]


def test_annotations_are_converted(tmp_path, monkeypatch):
    sequence = tmp_path / "MOT-1"
    (sequence / "gt").mkdir(parents=True)
    (sequence / "seqinfo.ini").write_text("[Sequence]\nseqLength=0\n")
    (sequence / "gt/gt.txt").write_text("")
    assert searchlight(monkeypatch, "convert-annotations", "mot", tmp_path, "--out", tmp_path / "a.json") == 2
    assert not (tmp_path / "a.json").exists()

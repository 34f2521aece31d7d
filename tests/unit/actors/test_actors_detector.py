"""``searchlight detector``: what it says and writes, with a small network whose weights are planted."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from matplotlib.image import imread, imsave

sys.path.insert(0, str(Path(__file__).parents[1] / "detection"))
from planted import Net, damo, spot, yolov8
from typer.testing import CliRunner

from actors.cli import app
from pipeline.config.pool import load_pool
from pipeline.detection import LayoutQuestionError, open_pool_detector
from pipeline.errors import InputError
from pipeline.evaluation.measuring.setup_timing import SetupTiming
from pipeline.evaluation.pool import detector_row
from pipeline.simulation.video_writer import write_video

POOL = Path(__file__).parents[3] / "configs" / "pools" / "demo.yaml"
TIMING = SetupTiming(
    detector="x",
    machine="here",
    provider="cpu",
    threads=2,
    clock="wall",
    pictures=20,
    minimum_s=0.01,
    mean_s=0.02,
    maximum_s=0.03,
    p95_s=0.025,
    memory_bytes=50_000_000,
    sharing={2: 1.2},
    busy=None,
)


@pytest.fixture(scope="module")
def net(tmp_path_factory):
    made = Net(metadata={"names": {0: "car", 1: "person", 2: "boat"}})
    yolov8(made)
    made.path = made.save(tmp_path_factory.mktemp("net") / "seen.onnx")
    return made


def run(*arguments: object) -> str:
    result = CliRunner().invoke(app, ["detector", *map(str, arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def test_inspect_says_what_was_recognised_and_why(net):
    said = run("inspect", net.path)
    assert ": yolov8" in said
    assert "why: 504 candidates are one for each cell of the strides (8, 16, 32)" in said
    assert "classes: 3: car, person, boat" in said
    section = yaml.safe_load(said[said.index("layout:") :])
    assert section["layout"]["output"]["order"] == "columns"


def test_inspect_asks_where_two_layouts_fit_and_uses_the_answer(tmp_path):
    made = Net(range=255.0)
    damo(made)
    path = made.save(tmp_path / "two.onnx")
    with pytest.raises(LayoutQuestionError, match="damoyolo or yolo_nas"):
        run("inspect", path, "--names", "a,person,b")
    assert ": damoyolo" in run("inspect", path, "--names", "a,person,b", "--layout", "damoyolo")


def test_a_layout_in_a_file_is_used(net, tmp_path):
    said = run("inspect", net.path)
    (tmp_path / "layout.yaml").write_text(said[said.index("layout:") :], encoding="utf-8")
    assert ": described" in run("inspect", net.path, "--layout", tmp_path / "layout.yaml")


def test_names_beside_a_layout_in_a_file_are_used(tmp_path):
    made = Net(range=255.0)
    damo(made)
    path = made.save(tmp_path / "two.onnx")
    said = run("inspect", path, "--names", "a,person,b", "--layout", "damoyolo")
    section = said[said.index("layout:") :] + "names: [crow, person, bee]\n"
    (tmp_path / "layout.yaml").write_text(section, encoding="utf-8")
    assert "classes: 3: crow, person, bee" in run("inspect", path, "--layout", tmp_path / "layout.yaml")
    with_others = run("inspect", path, "--layout", tmp_path / "layout.yaml", "--names", "x,person,y")
    assert "classes: 3: x, person, y" in with_others


def test_try_draws_the_boxes(net, tmp_path):
    image, box = spot(net)
    imsave(tmp_path / "in.png", image)
    said = run("try", net.path, tmp_path / "in.png", "--out", tmp_path / "out.png")
    assert "1 boxes" in said
    drawn = imread(tmp_path / "out.png")[..., :3]
    x0, y0, x1, y1 = (round(v) for v in box)
    red = (drawn[..., 0] > 0.9) & (drawn[..., 1] < 0.2)
    assert red[y0, x0 : x1 + 1].all()
    assert red[y0 : y1 + 1, x1].all()
    assert not red[: y0 - 1].any()


def test_try_writes_a_video_of_as_many_pictures(net, tmp_path):
    from pipeline.config.scenario import Recording
    from pipeline.ingest.video.file import open_video

    image, _ = spot(net)
    recording = Recording(frame_rate={"hertz": 25}, bitrate={"mbps": 4}, preset="veryfast")
    write_video(tmp_path / "in.mp4", [image] * 6, recording)
    said = run("try", net.path, tmp_path / "in.mp4", "--out", tmp_path / "out.mp4", "--pictures", 4)
    assert "in 4 pictures" in said
    assert open_video(tmp_path / "out.mp4").frames == 4


def test_try_says_what_a_tiling_costs_on_a_4k_frame_and_who_is_seen_whole(net, tmp_path):
    imsave(tmp_path / "in.png", spot(net)[0])
    said = run(
        "try", net.path, tmp_path / "in.png", "--out", tmp_path / "out.png", "--tiles", "960x540", "--overlap", 0.2
    )  # fmt: skip
    assert "tiles: 25 looks at a frame of 3840 x 2160: " in said.replace("\n", " ")
    assert "people up to 160 x 90 pixels are seen whole" in said.replace("\n", " ")


def labels(net, folder: Path, count: int = 6) -> Path:
    """Pictures with one person each, of which every third has a label beside the person."""
    images, annotations = [], []
    for k in range(count):
        image, (x0, y0, x1, y1) = spot(net, 3 + k, 4)
        imsave(folder / f"{k}.png", image)
        images.append(
            {"id": k + 1, "file_name": f"{k}.png", "width": image.shape[1], "height": image.shape[0]}
        )
        shift = 100 if k % 3 == 2 else 0
        box = [x0 + shift, y0, x1 - x0, y1 - y0]
        annotations.append(
            {
                "id": k + 1,
                "image_id": k + 1,
                "category_id": 1,
                "bbox": box,
                "area": box[2] * box[3],
                "iscrowd": 0,
            }
        )
    document = {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": "person"}]}
    path = folder / "labels.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def test_add_writes_a_pool_from_labels(net, tmp_path, monkeypatch):
    monkeypatch.setattr(detector_row, "timed", lambda *_, **__: TIMING)
    out = tmp_path / "pool.yaml"
    said = run(
        "add", net.path, "--labels", labels(net, tmp_path), "--machine", "here", "--out", out, "--tiles", "384x256",
        "--whole", "--threads", 2,
    )  # fmt: skip
    assert "6 people" in said
    (row,) = load_pool(out).detectors
    assert 0.3 < row.accuracy[0].accuracy < 0.9
    assert {r.size for r in row.accuracy_by_size} <= {"small", "medium", "large"}
    assert "as they are (6 pictures, 6 people), not of encoded video" in row.assumed
    assert "20 ms, 50 MB in all" in said.replace("\n", " ")
    assert (row.tiles.size, row.tiles.whole, row.times[0].threads) == ((384, 256), True, 2)
    assert open_pool_detector(row).setup.tiling.width == 384


def test_add_looks_at_labelled_frames_of_a_video(net, tmp_path, monkeypatch):
    from pipeline.config.scenario import Recording

    monkeypatch.setattr(detector_row, "timed", lambda *_, **__: TIMING)
    nobody, box = np.full((256, 384, 3), 90, np.uint8), spot(net)[1]
    frames = [spot(net)[0] if k in (3, 7) else nobody for k in range(12)]
    recording = Recording(frame_rate={"hertz": 25}, bitrate={"mbps": 20}, preset="veryfast")
    write_video(tmp_path / "a.mp4", frames, recording)
    document = {
        "images": [
            {"id": f"f{k}", "file_name": f"a.mp4#{k}", "width": 384, "height": 256} for k in (0, 3, 7)
        ],
        "annotations": [
            {"id": k, "image_id": f"f{k}", "category_id": 1, "bbox": [box[0], box[1], 48, 80]} for k in (3, 7)
        ],
        "categories": [{"id": 1, "name": "person"}],
    }
    (tmp_path / "labels.json").write_text(json.dumps(document), encoding="utf-8")
    out = tmp_path / "pool.yaml"
    run("add", net.path, "--labels", tmp_path / "labels.json", "--machine", "here", "--out", out)
    (row,) = load_pool(out).detectors
    assert "(3 pictures, 2 people)" in row.assumed
    assert row.accuracy[0].accuracy == pytest.approx(1.0, abs=1e-3)


def test_add_without_labels_is_marked_as_assumed(net, tmp_path, monkeypatch):
    monkeypatch.setattr(detector_row, "timed", lambda *_, **__: TIMING)
    out = tmp_path / "pool.yaml"
    run("add", net.path, "--assume-like", "small", "--pool", POOL, "--machine", "here", "--out", out)
    pool = load_pool(out)
    like = next(d for d in load_pool(POOL).detectors if d.id == "small")
    (row,) = pool.detectors
    assert [a.accuracy for a in row.accuracy] == [a.accuracy for a in like.accuracy]
    assert [a.bitrate for a in row.accuracy] == pytest.approx([a.bitrate for a in like.accuracy])
    assert row.calibration is None
    assert "never measured" in row.assumed
    assert pool.assumed == (f"{row.id}: {row.assumed}",)
    shown = CliRunner().invoke(app, ["pool", "show", str(out)])
    assert "never measured" in shown.output


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ((), "found neither; expected one of both"),
        (("--assume-like", "nobody", "--pool", POOL), "'nobody'; expected a detector of"),
        (("--assume-like", "small"), "--pool: found nothing"),
        (("--assume-like", "small", "--pool", POOL, "--tiles", "wide"), "--tiles: found 'wide'"),
    ],
)
def test_add_refuses_what_it_cannot_do(net, tmp_path, arguments, match):
    with pytest.raises(InputError, match=match):
        run("add", net.path, "--machine", "here", "--out", tmp_path / "pool.yaml", *arguments)


def test_a_file_that_is_not_there_is_one_line(tmp_path):
    for command in (["inspect"], ["try", "x.png"]):
        with pytest.raises(InputError, match=r"nobody\.onnx: found no file"):
            run(command[0], tmp_path / "nobody.onnx", *command[1:])


def test_calibration_is_judged_on_pictures_that_it_was_not_fitted_to():
    from pipeline.evaluation.labelled import _calibration
    from pipeline.evaluation.metrics.boxes import found_boxes, true_boxes
    from pipeline.evaluation.metrics.matching import match

    rng = np.random.default_rng(3)
    n = 4000
    image, score = np.arange(n), rng.uniform(0.1, 0.9, n)
    right = rng.random(n) < score**2
    box = np.tile([10.0, 10.0, 20.0, 40.0], (n, 1))
    true = true_boxes(image, np.ones(n, int), box, np.full(n, 800.0), np.zeros(n, bool))
    found = found_boxes(
        image, np.ones(n, int), box + np.where(right, 0.0, 300.0)[:, None] * [1, 0, 0, 0], score
    )
    calibration, before, after = _calibration(match(true, found, "all", np.array([0.5])), 0.1)
    assert calibration is not None
    assert after < 0.05 < before

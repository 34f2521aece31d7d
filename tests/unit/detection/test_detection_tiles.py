"""Pictures in tiles: they cover the picture, and a person on a seam is one person."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.detection import load_detector
from pipeline.detection.tiles import merged, whole_up_to, windows_of
from pipeline.sensor.setup import Tiling

sides = st.integers(32, 600)


@given(sides, sides, sides, sides, st.floats(0.0, 0.9), st.booleans())
def test_tiles_cover_the_picture_and_stay_inside_it(width, height, tile_width, tile_height, overlap, whole):
    windows = windows_of(width, height, Tiling(tile_width, tile_height, overlap, whole))
    seen = np.zeros((height, width), bool)
    for x0, y0, x1, y1 in windows:
        assert 0 <= x0 < x1 <= width
        assert 0 <= y0 < y1 <= height
        seen[y0:y1, x0:x1] = True
    assert seen.all()
    assert ([0, 0, width, height] in windows.tolist()) >= whole


@given(st.integers(200, 600), st.floats(0.0, 0.8))
def test_neighbouring_tiles_overlap_by_what_was_asked_for_at_least(width, overlap):
    windows = windows_of(width, 64, Tiling(100, 64, overlap, False))
    shared = windows[:-1, 2] - windows[1:, 0]
    assert (shared >= 100 * overlap - 1).all()


@given(st.integers(200, 500), st.integers(200, 500), st.floats(0.1, 0.8), st.randoms(use_true_random=False))
def test_whoever_is_small_enough_is_seen_whole_by_a_tile_wherever_he_is(width, height, overlap, chance):
    tiling = Tiling(100, 80, overlap, False)
    wide, high = whole_up_to(width, height, tiling)
    if not (wide and high):
        return
    windows = windows_of(width, height, tiling)
    x, y = chance.uniform(0, width - wide), chance.uniform(0, height - high)
    person, score = np.array([[x, y, x + wide, y + high]]), np.ones(1)
    inside = (windows[:, :2] <= person[0, :2]).all(axis=1) & (person[0, 2:] <= windows[:, 2:]).all(axis=1)
    kept = [merged(person, score, np.array([k]), windows, (width, height))[0] for k in np.flatnonzero(inside)]
    assert any(len(boxes) for boxes in kept)


def test_two_halves_of_a_person_on_a_seam_become_the_person():
    windows = np.array([[0, 0, 100, 100], [80, 0, 180, 100]])
    boxes = np.array([[70.0, 20, 100, 90], [80, 20, 120, 90], [10, 10, 30, 60]])
    window = np.array([0, 1, 0])
    found, scores, _ = merged(boxes, np.array([0.7, 0.8, 0.9]), window, windows, (180, 100))
    np.testing.assert_array_equal(found, [[10, 10, 30, 60], [70, 20, 120, 90]])
    assert scores.tolist() == [0.9, 0.8]


def once(boxes, scores, window, windows=((0, 0, 100, 100), (60, 0, 160, 100)), size=(160, 100)):
    found = merged(
        np.array(boxes, float), np.array(scores), np.array(window), np.array(windows, np.int64), size
    )
    return found[0].tolist(), found[1].tolist()


def test_a_box_that_a_seam_cuts_goes_where_the_neighbour_sees_the_place_whole():
    # the person is 70..95: too near to the first tile's end at 100 for the network to see where it stops
    cut, whole = [70.0, 20, 99, 60], [70.0, 20, 95, 60]
    assert once([cut, whole], [0.9, 0.5], [0, 1]) == ([whole], [0.5])
    # and the neighbour, which found nothing there, is believed
    assert once([cut], [0.9], [0]) == ([], [])
    # at the end of the picture nothing is cut
    assert once([[130.0, 20, 159, 60]], [0.9], [1]) == ([[130.0, 20, 159, 60]], [0.9])


@pytest.mark.parametrize("least", [0.15, 0.6])
def test_a_half_joins_the_other_only_if_it_is_about_as_sure(least):
    # wider than the overlap: no tile sees this person whole
    left, right = [40.0, 20, 100, 80], [60.0, 20, 120, 80]
    (box,), (score,) = once([left, right], [0.8, least], [0, 1])
    assert box == ([40, 20, 120, 80] if least > 0.4 else left)
    assert score == 0.8


def test_the_pass_over_the_whole_picture_takes_no_box_away_that_it_does_not_find():
    windows = [(0, 0, 100, 100), (90, 0, 190, 100), (0, 0, 190, 100)]
    cut = [70.0, 20, 99, 60]  # no other tile sees it whole, the whole picture does
    assert once([cut], [0.9], [0], windows, (190, 100)) == ([cut], [0.9])
    whole = [70.0, 20, 104, 60]
    assert once([cut, whole], [0.9, 0.3], [0, 2], windows, (190, 100)) == ([whole], [0.9])


@pytest.mark.parametrize("seed", range(20))
def test_everybody_smaller_than_the_overlap_is_found_once_and_whole(seed):
    """What a perfect network says of each tile: the visible part of everybody, a little off, surer here or there."""
    rng = np.random.default_rng(seed)
    size, tiling = (900, 700), Tiling(320, 256, 0.3, bool(seed % 2))
    windows = windows_of(*size, tiling)
    overlap = 0.3 * 256
    corner = np.stack(np.meshgrid(np.arange(0, 840, 90), np.arange(0, 640, 90)), axis=-1).reshape(-1, 2)
    corner = corner + rng.integers(0, 30, corner.shape)
    side = rng.uniform(8, overlap / 1.6, corner.shape)
    people = np.hstack([corner, np.minimum(corner + side, size)])
    boxes, scores, window = [], [], []
    for k, (x0, y0, x1, y1) in enumerate(windows):
        seen = np.clip(people, [x0, y0, x0, y0], [x1, y1, x1, y1])
        for box, whole in zip(seen, people, strict=True):
            share = (box[2:] - box[:2]).prod() / (whole[2:] - whole[:2]).prod()
            if share > 0.3 and not (k == len(windows) - 1 and tiling.whole):  # too small for the whole frame
                boxes.append(box + rng.uniform(-0.5, 0.5, 4))
                scores.append(rng.uniform(0.3, 1.0))
                window.append(k)
    found, _, _ = merged(np.array(boxes), np.array(scores), np.array(window), windows, size)
    assert len(found) == len(people)
    for person in people:
        assert np.abs(found - person).max(axis=1).min() <= 1.0


def test_people_beside_each_other_in_one_tile_stay_two():
    windows = np.array([[0, 0, 100, 100], [80, 0, 180, 100]])
    boxes = np.array([[10.0, 20, 40, 90], [20, 20, 50, 90]])
    found, _, _ = merged(boxes, np.array([0.6, 0.9]), np.array([0, 0]), windows, (180, 100))
    assert len(found) == 2


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("x", [40, 168, 176, 184, 192, 200, 345])
def test_a_network_finds_in_tiles_what_it_cannot_find_in_the_whole_picture(tmp_path, free, whole, x):
    """Wherever the person stands, on a seam or not, in tiles one by one or in a batch."""
    pytest.importorskip("onnx", reason="onnx is not installed")
    from planted import HEIGHT, WIDTH, Net, yolov8

    net = Net(free=free, metadata={"imgsz": [HEIGHT, WIDTH]})
    yolov8(net)
    path = net.save(tmp_path / "n.onnx")
    image = np.full((2 * HEIGHT, 2 * WIDTH, 3), 90, np.uint8)
    image[96:104, x : x + 8] = [255, 0, 0]  # a cell of the input at the picture's own size
    names = ("cow", "person", "boat")
    frame = load_detector(path, score_threshold=0.3, names=names)
    tiled = load_detector(path, score_threshold=0.3, names=names, tiling=Tiling(WIDTH, HEIGHT, 0.5, whole))
    assert len(frame.detect(image)[0]) == 0
    boxes, _, _ = tiled.detect(image)
    assert len(boxes) >= 1
    assert np.abs(boxes[0] - [x + 4 - 12, 100 - 20, x + 4 + 12, 100 + 20]).max() <= 8.0


def test_batches_give_what_tiles_one_by_one_give(tmp_path, monkeypatch):
    pytest.importorskip("onnx", reason="onnx is not installed")
    from planted import HEIGHT, WIDTH, Net, yolox

    from pipeline.detection.session import Session

    sizes = []
    run = Session.run
    monkeypatch.setattr(
        Session, "run", lambda self, inputs: sizes.append(len(inputs["in"])) or run(self, inputs)
    )
    found = []
    for free in (False, True):
        net = Net(free=free, bgr=True, range=255.0, metadata={"imgsz": [HEIGHT, WIDTH]})
        yolox(net)
        path = net.save(tmp_path / f"{free}.onnx")
        tiling = Tiling(WIDTH, HEIGHT, 0.25, False)
        detector = load_detector(path, score_threshold=0.1, names=("a", "person", "b"), tiling=tiling)
        sizes.clear()
        image = np.random.default_rng(1).integers(0, 90, (300, 700, 3), dtype=np.uint8)
        image[40:48, 80:88] = [255, 0, 0]
        found.append(detector.detect(image))
        assert sizes == ([1] * 15 if not free else [8, 7]), sizes
    for a, b in zip(*found, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-4)

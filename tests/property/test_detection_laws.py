from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pipeline.detection.nms import iou, non_maximum_suppression
from pipeline.detection.placement import letterbox, stretch
from pipeline.detection.resize import resize

coordinate = st.integers(0, 20).map(float)
box = st.tuples(coordinate, coordinate, st.integers(0, 12), st.integers(0, 12)).map(
    lambda b: (b[0], b[1], b[0] + b[2], b[1] + b[3])
)
scored_boxes = st.lists(st.tuples(box, st.integers(0, 5)), max_size=25)
size = st.integers(2, 64)


def brute_force_iou(a, b):
    pixels = [
        {(x, y) for x in range(int(p[0]), int(p[2])) for y in range(int(p[1]), int(p[3]))} for p in (a, b)
    ]
    union = len(pixels[0] | pixels[1])
    return len(pixels[0] & pixels[1]) / union if union else 0.0


@given(box, st.lists(box, min_size=1, max_size=5))
def test_iou_counts_the_pixels_in_both_by_those_in_either(a, others):
    expected = [brute_force_iou(a, b) for b in others]
    np.testing.assert_allclose(iou(np.array(a), np.array(others)), expected, atol=1e-12)


@given(scored_boxes, st.sampled_from([0.0, 0.25, 0.5, 1.0]))
def test_suppression_keeps_what_brute_force_keeps(items, threshold):
    boxes = np.array([b for b, _ in items], float).reshape(-1, 4)
    scores = np.array([s for _, s in items], float)
    kept = []
    for i in sorted(range(len(items)), key=lambda i: -scores[i]):
        if all(brute_force_iou(boxes[k], boxes[i]) <= threshold for k in kept):
            kept.append(i)
    assert non_maximum_suppression(boxes, scores, threshold).tolist() == kept


@given(size, size, size, size, st.booleans())
def test_a_box_goes_through_the_letterbox_and_back(width, height, input_width, input_height, centred):
    image = np.zeros((height, width, 3), np.uint8)
    placed, placement = letterbox(image, input_width, input_height, fill=114, centred=centred)
    boxes = np.array([[0.0, 0.0, width, height], [1.0, 2.0, 1.5, 7.0]])
    assert placed.shape == (input_height, input_width, 3)
    np.testing.assert_allclose(
        placement.image_from_input(placement.input_from_image(boxes)), boxes, atol=1e-9
    )


@given(st.integers(8, 64), st.integers(8, 64), st.booleans())
def test_the_letterboxed_picture_is_where_its_placement_says(width, height, centred):
    image = np.full((height, width, 3), 255, np.uint8)
    placed, placement = letterbox(image, 48, 32, fill=0, centred=centred)
    y, x = np.nonzero(placed[..., 0])
    found = [x.min(), y.min(), x.max() + 1, y.max() + 1]
    expected = placement.input_from_image(np.array([[0.0, 0.0, width, height]]))[0]
    np.testing.assert_allclose(found, expected, atol=1e-9)


@settings(deadline=None)
@given(size, size, size, size, st.integers(0, 255), st.sampled_from(["area", "linear", "triangle"]))
def test_a_picture_of_one_colour_keeps_it(width, height, out_width, out_height, value, method):
    image = np.full((height, width, 3), value, np.uint8)
    assert (resize(image, out_width, out_height, method) == value).all()


@settings(deadline=None)
@given(hnp.arrays(np.uint8, (12, 20, 3)), st.integers(7, 20), st.integers(4, 12))
def test_area_shrinking_to_a_third_keeps_the_mean(image, out_width, out_height):
    small = resize(image, out_width, out_height)
    np.testing.assert_allclose(small.mean(axis=(0, 1)), image.mean(axis=(0, 1)), atol=2.6)  # weights in 1/256


@settings(deadline=None)
@given(hnp.arrays(np.uint8, (40, 60, 3)), size, size, st.sampled_from(["area", "linear", "triangle"]))
def test_no_pixel_is_brighter_or_darker_than_all_that_it_stands_for(image, out_width, out_height, method):
    small = resize(image, out_width, out_height, method)
    assert small.min() >= image.min()
    assert small.max() <= image.max()


@given(size, size, size, size)
def test_stretching_maps_the_picture_onto_the_whole_input(width, height, input_width, input_height):
    placed, placement = stretch(np.zeros((height, width, 3), np.uint8), input_width, input_height)
    assert placed.shape == (input_height, input_width, 3)
    corner = placement.input_from_image(np.array([[0.0, 0.0, width, height]]))
    np.testing.assert_allclose(corner, [[0, 0, input_width, input_height]])

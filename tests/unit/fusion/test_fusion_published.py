"""What is published of a place: its boxes' calibrated scores, not the state of the filter."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pipeline.fusion.fuser import Fuser
from pipeline.fusion.possible import found_and_possible
from pipeline.fusion.published import published_probability
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections
from pipeline.sensor.substream import SubstreamModel

PLANE = Terrain(LocalFrame(47.0, 8.0), -40.0, -40.0, 0.5, np.zeros((160, 160), dtype=np.float32))
DOWN = enu_from_camera(0.0, -math.pi / 2.0, 0.0)


def _hover(params, camera, hits, frames, *, score, walk_m=0.0, rule="with_uncertainty"):
    """A drone hovers at 20 m over somebody who is detected in the first hits of every ten frames; found, possible."""
    params = params.model_copy(update={"update_rule": rule, "negative_max": 0.4})
    fuser = Fuser(PLANE, params, {"a": camera}, {"d": 1.0})
    for k in range(frames):
        foot = 512.0 + 45.0 * walk_m * k / frames
        boxes = [[foot - 20.0, 248.0, foot + 20.0, 288.0]] if k % 10 < hits else []
        count = len(boxes)
        pose = CameraPose(np.array([0.0, 0.0, 20.0]), DOWN)
        fuser.apply(
            Detections(
                "a", "d", k, k * 10**9, pose,
                np.array(boxes).reshape(count, 4), np.full(count, score), np.zeros(count, np.int64),
            )
        )  # fmt: skip
    return fuser, found_and_possible(fuser.maps, fuser.looks, params)


def test_somebody_who_is_missed_by_most_frames_is_found_by_the_boxes_that_saw_him(params, camera):
    fuser, (found, possible) = _hover(params, camera, 1, 50, score=0.9)
    assert float(fuser.map.probability()[PLANE.cell(0.1, 0.1)]) < 0.3
    (place,) = found
    assert place.probability == pytest.approx(0.9)
    assert place.map_probability < 0.3
    assert possible == ()
    assert place.id == 1


def test_boxes_that_are_probably_wrong_make_a_possible_place(params, camera):
    _, (found, possible) = _hover(params, camera, 1, 50, score=0.4)
    assert found == ()
    assert [place.probability for place in possible] == [pytest.approx(0.4)]


def test_many_looks_at_one_thing_do_not_make_it_surer(params, camera):
    few, many = (_hover(params, camera, 9, frames, score=0.8)[1][0] for frames in (10, 100))
    assert few[0].probability == pytest.approx(many[0].probability)
    assert many[0].map_probability > few[0].map_probability - 1e-6


def test_the_way_of_somebody_who_walks_is_not_found_as_one_place(params, camera):
    _, (found, possible) = _hover(params, camera, 3, 50, score=0.9, walk_m=9.0)
    assert all(place.spread_m <= params.cluster_distance for place in found)
    assert any(place.spread_m > params.cluster_distance for place in possible)


def test_by_the_papers_rule_a_place_is_as_probable_as_its_cells(params, camera):
    _, (found, possible) = _hover(params, camera, 1, 50, score=0.9, rule="paper")
    assert found == ()
    _, (found, _) = _hover(params, camera, 10, 50, score=0.9, rule="paper")
    assert found[0].probability == found[0].map_probability
    assert possible[0].probability < 0.3


def test_scores_are_averaged_in_log_odds(params, camera):
    fuser, _ = _hover(params, camera, 1, 10, score=0.9)
    (look,) = fuser.looks
    looks = [replace(look, score=score) for score in (0.9, 0.5)]
    assert published_probability(looks) == pytest.approx(0.75)
    assert published_probability([replace(look, score=1.0)]) == pytest.approx(0.99)
    assert published_probability(looks) == pytest.approx(published_probability(looks * 5))


def test_a_score_that_does_not_hold_at_the_bitrate_makes_nobody_found(params, camera):
    uncertain = params.model_copy(update={"update_rule": "with_uncertainty"})
    model = SubstreamModel(raises=0.1, lowers=0.1, trust=0.1)
    fuser = Fuser(PLANE, uncertain, {"a": camera}, {"d": 1.0}, substreams={("a", "d"): model})
    pose = CameraPose(np.array([0.0, 0.0, 20.0]), DOWN)
    box = np.array([[492.0, 248.0, 532.0, 288.0]])
    for k in range(5):
        fuser.apply(Detections("a", "d", k, k * 10**9, pose, box, np.array([0.9]), np.zeros(1, np.int64)))
    found, possible = found_and_possible(fuser.maps, fuser.looks, uncertain)
    assert found == ()
    assert [place.probability for place in possible] == [pytest.approx(0.09)]

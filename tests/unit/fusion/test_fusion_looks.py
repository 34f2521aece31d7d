"""How well each place was observed, worked out by hand."""

import math

import numpy as np
import pytest

from pipeline.fusion.fuser import Fuser
from pipeline.geo.pose import enu_from_camera
from pipeline.messages import CameraPose, Detections
from pipeline.sensor.model import SensorModel

SECOND = 1_000_000_000
START = 1_777_629_600 * SECOND


def _frame(time_s, up=15.0, detector="d", boxes=(), scores=None):
    pose = CameraPose(np.array([0.1, -0.1, up]), enu_from_camera(0.0, math.radians(-90.0), 0.0))
    boxes = np.array(boxes, dtype=np.float64).reshape(-1, 4)
    scores = np.full(len(boxes), 0.8) if scores is None else scores
    time_ns = START + round(time_s * SECOND)
    return Detections("a", detector, 0, time_ns, pose, boxes, scores, np.zeros(len(boxes), dtype=np.int64))


@pytest.fixture
def fuser(plane, params, camera):
    return Fuser(plane, params, {"a": camera}, {"d": 1.0, "half": 0.5})


BELOW = (79, 80)  # the cell under the camera, its centre at 0.25, -0.25


def _pod(camera, params, up, p_detector=1.0):
    """p_det^rel, times the share that is left of 0.2 m * 900 px / 4 px = 45 m, times the Tukey window."""
    distance = math.hypot(0.15, 0.15, up)
    position = (0.5 * 1.7 - 0.2 * 0.2) / (2.2 * 2.2 - 0.2 * 0.2)  # of a standing person's area, on the rise
    tukey = 0.5 * (1.0 - math.cos(2.0 * math.pi * position / 0.5))
    return p_detector * (1.0 - distance / 45.0) * tukey


def test_the_first_look_by_hand(fuser, camera, params):
    fuser.apply(_frame(0.0))
    voxel_map, distance = fuser.map, math.hypot(0.15, 0.15, 15.0)
    assert voxel_map.looks[BELOW] == 1
    assert voxel_map.resolution_px[BELOW] == pytest.approx(900.0 * 1.7 / distance, abs=1.0 / 16.0)
    assert voxel_map.pod[BELOW] == pytest.approx(_pod(camera, params, 15.0), rel=1e-6)
    assert voxel_map.last_seen_ns[BELOW] == START


def test_what_was_never_seen_is_zero_in_every_layer(fuser):
    fuser.apply(_frame(0.0))
    unseen = fuser.map.observations == 0
    assert unseen.any()
    for name in ("looks", "resolution_px", "pod", "last_seen_ns"):
        assert not fuser.map.layer(name)[unseen].any()
        assert fuser.map.layer(name)[~unseen].all()


def test_frames_in_a_row_are_one_look_as_good_as_the_best_of_them(fuser, camera, params):
    for i, up in enumerate((20.0, 10.0, 15.0)):
        fuser.apply(_frame(0.9 * i, up))
    assert fuser.map.looks[BELOW] == 1
    assert fuser.map.observations[BELOW] == 3
    assert fuser.map.pod[BELOW] == pytest.approx(_pod(camera, params, 10.0), rel=1e-6)
    assert fuser.map.resolution_px[BELOW] == pytest.approx(
        900.0 * 1.7 / math.hypot(0.15, 0.15, 10.0), abs=1.0 / 16.0
    )


def test_looks_apart_multiply_what_they_miss(fuser, camera, params):
    for time_s, up in ((0.0, 20.0), (5.0, 10.0), (5.5, 15.0), (20.0, 15.0)):
        fuser.apply(_frame(time_s, up))
    missed = np.prod([1.0 - _pod(camera, params, up) for up in (20.0, 10.0, 15.0)])
    assert fuser.map.looks[BELOW] == 3
    assert fuser.map.pod[BELOW] == pytest.approx(1.0 - missed, rel=1e-5)
    assert fuser.map.last_seen_ns[BELOW] == START + 20 * SECOND


def test_a_less_accurate_detector_has_a_lower_pod(fuser, camera, params):
    fuser.apply(_frame(0.0, detector="half"))
    assert fuser.map.pod[BELOW] == pytest.approx(_pod(camera, params, 15.0, 0.5), rel=1e-6)


def test_what_lies_behind_a_box_was_not_looked_at_but_what_it_raised_was(fuser):
    fuser.apply(_frame(0.0, boxes=[(497.0, 200.0, 527.0, 300.0)]))
    (look,) = fuser.looks
    behind = (81, 80)  # its centre is 51 px above the picture's
    assert fuser.map.looks[behind] == 0
    assert (look.row, look.column) == BELOW
    assert fuser.map.observations[BELOW] == 1
    assert fuser.map.looks[BELOW] == 1
    assert fuser.map.log_odds[BELOW] > 0.0


def test_two_detectors_on_a_frame_are_one_look(fuser):
    fuser.apply(_frame(0.0))
    fuser.apply(_frame(0.0, detector="half"))
    assert fuser.map.looks[BELOW] == 1
    assert fuser.map.observations[BELOW] == 2


def test_the_pod_of_other_classes_is_that_of_the_middle_of_their_sizes(camera, params):
    boat = params.classes[0].model_copy(update={"typical_width": None, "typical_height": None})
    model = SensorModel(camera, params, boat)
    # 1.2 m x 1.2 m lies at (1.44 - 0.04) / 4.8 = 0.29 of the window, on the plateau
    assert model.typical_area_component == 1.0
    assert model.frame_pod(22.5, 0.8) == pytest.approx(0.4)


def _two_classes(params):
    size = {name: {"meters": value} for name, value in params.object_size.model_dump().items()}
    boat = {"id": 4, "name": "boat", "significant_point": "center", "object_size": size}
    wide = {name: {"meters": value * 10.0} for name, value in params.object_size.model_dump().items()}
    ship = boat | {"id": 5, "name": "ship", "object_size": wide}
    boats = [type(params.classes[0]).model_validate(c) for c in (boat, ship)]
    return params.model_copy(update={"further_classes": tuple(boats)})


def test_each_class_has_its_layer_and_its_sizes(plane, params, camera):
    fuser = Fuser(plane, _two_classes(params), {"a": camera}, {"d": 1.0})
    box = (497.0, 250.0, 527.0, 300.0)
    frame = _frame(0.0, boxes=[box, box, box, box])
    frame.class_ids[:] = [0, 4, 5, 6]
    fuser.apply(frame)
    assert [look.class_name for look in fuser.looks] == ["person", "boat"]
    assert fuser.unplaced == {"not the size of its class, or no trust": 1, "class without a layer": 1}
    raised = {name: (voxel_map.log_odds > 0.0).sum() for name, voxel_map in fuser.maps.items()}
    assert raised == {"person": 1, "boat": 1, "ship": 0}
    # the significant point of a boat is its centre, 25 px above the person's
    assert fuser.looks[0].row < fuser.looks[1].row
    # a ship is seen from ten times as far
    assert fuser.maps["ship"].pod[0, 80] >= fuser.maps["boat"].pod[0, 80]


def _from(stream, time_s, east=0.1, north=-0.1, up=15.0):
    """A frame of a stream that looks straight down; the cell BELOW is in it from a few metres aside too."""
    pose = CameraPose(np.array([east, north, up]), enu_from_camera(0.0, math.radians(-90.0), 0.0))
    none = np.zeros((0, 4)), np.zeros(0), np.zeros(0, dtype=np.int64)
    return Detections(stream, "d", 0, START + round(time_s * SECOND), pose, *none)


@pytest.fixture
def team(plane, params, camera):
    return Fuser(plane, params, dict.fromkeys("abc", camera), {"d": 1.0})


APART = {"a": (0.1, -0.1), "b": (4.1, -0.1), "c": (0.1, 3.4)}


def _fly(fuser, streams, count, step_s=0.1, start_s=0.0):
    for k in range(count):
        for stream in streams:
            fuser.apply(_from(stream, start_s + k * step_s, *APART[stream]))


def _best(camera, params, stream):
    distance = math.hypot(APART[stream][0] - 0.25, APART[stream][1] + 0.25, 15.0)
    position = (0.5 * 1.7 - 0.2 * 0.2) / (2.2 * 2.2 - 0.2 * 0.2)
    return (1.0 - distance / 45.0) * 0.5 * (1.0 - math.cos(2.0 * math.pi * position / 0.5))


def test_two_drones_that_see_a_place_at_once_are_two_looks(team, camera, params):
    _fly(team, "ab", 30)
    assert team.map.looks[BELOW] == 2
    missed = (1.0 - _best(camera, params, "a")) * (1.0 - _best(camera, params, "b"))
    assert team.map.pod[BELOW] == pytest.approx(1.0 - missed, abs=0.004)
    assert team.map.pod[BELOW] <= 1.0 - missed + 1e-6  # rounded down


def test_they_stay_two_looks_however_their_frames_come(team):
    for k, stream in enumerate("aababbbaabababbaaab"):
        team.apply(_from(stream, 0.2 * k, *APART[stream]))
    assert team.map.looks[BELOW] == 2


def test_a_drone_that_comes_back_after_a_pause_begins_a_look_beside_the_one_that_stayed(team):
    _fly(team, "ab", 10)
    _fly(team, "a", 30, start_s=1.0)
    _fly(team, "ab", 10, start_s=4.0)
    assert team.map.looks[BELOW] == 3


def test_one_that_stays_within_the_pause_goes_on_with_its_look(team):
    _fly(team, "ab", 10)
    _fly(team, "a", 9, start_s=1.0)
    _fly(team, "ab", 10, start_s=1.8)
    assert team.map.looks[BELOW] == 2


def test_a_third_one_at_the_same_time_counts_too_little_rather_than_too_much(team, camera, params):
    _fly(team, "abc", 30)
    assert team.map.looks[BELOW] == 2
    all_three = np.prod([1.0 - _best(camera, params, stream) for stream in "abc"])
    assert team.map.pod[BELOW] < 1.0 - all_three


def test_the_same_two_again_later_are_two_looks_more(team, camera, params):
    _fly(team, "ab", 10)
    _fly(team, "ab", 10, start_s=30.0)
    assert team.map.looks[BELOW] == 4
    missed = (1.0 - _best(camera, params, "a")) * (1.0 - _best(camera, params, "b"))
    assert team.map.pod[BELOW] == pytest.approx(1.0 - missed**2, abs=0.004)


def test_two_cameras_of_one_aircraft_are_one_viewpoint(team):
    for k in range(30):
        east = 0.1 + 0.1 * k
        team.apply(_from("a", 0.1 * k, east))
        team.apply(_from("b", 0.1 * k + 0.03, east + 0.1, -0.2, 15.1))
    assert team.map.looks[BELOW] == 1


def test_looks_that_were_ended_are_over_and_lose_nothing(team):
    _fly(team, "ab", 10)
    before = team.map.pod[BELOW]
    team.map.end_looks()
    assert team.map.pod[BELOW] == pytest.approx(before, abs=1e-6)
    _fly(team, "a", 1, start_s=1.0)
    assert team.map.looks[BELOW] == 3

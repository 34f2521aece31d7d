import math
from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.uncertainty import EXACT
from pipeline.errors import InputError
from pipeline.fusion import fuser as fuser_module
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.voxel_map import log_odds
from pipeline.geo.pose import enu_from_camera
from pipeline.ingest.checks.box_sizes import BINS, size_bin
from pipeline.messages import CameraPose, Detections
from pipeline.sensor.model import SensorModel
from pipeline.sensor.substream import SubstreamModel

#: 15 m above the ground, looking north and 45 degrees down: the optical axis meets the ground 15 m ahead.
POSE = CameraPose(np.array([0.1, -0.1, 15.0]), enu_from_camera(0.0, math.radians(-45.0), 0.0))
#: its bottom centre is the principal point
PERSON = (487.0, 218.0, 537.0, 288.0)


def _frame(*boxes, scores=None, pose=POSE, stream="a", detector="d", time_ns=1):
    return Detections(
        stream=stream,
        detector=detector,
        index=0,
        time_ns=time_ns,
        pose=pose,
        boxes_px=np.array(boxes, dtype=np.float64).reshape(-1, 4),
        scores=np.array(scores if scores is not None else [0.8] * len(boxes)),
        class_ids=np.zeros(len(boxes), dtype=np.int64),
    )


@pytest.fixture
def fuser(plane, params, camera):
    return Fuser(plane, params, {"a": camera}, {"d": 1.0, "half": 0.5})


def _cell(fuser, east, north):
    return tuple(fuser.map.terrain.cells(np.array([[east, north]]))[0])


def test_a_detection_raises_the_voxel_under_its_bottom_centre(fuser, camera, params):
    fuser.apply(_frame(PERSON))
    distance = 15.0 * math.sqrt(2.0)
    p = SensorModel(camera, params).positive(np.array(PERSON), 0.8, distance, 1.0)
    raised = np.argwhere(fuser.map.log_odds > 0.0)
    assert p > 0.7
    assert [tuple(cell) for cell in raised] == [_cell(fuser, 0.1, 14.9)]
    assert fuser.map.log_odds[_cell(fuser, 0.1, 14.9)] == pytest.approx(
        float(log_odds(np.array(p))), abs=1e-3
    )


def test_the_look_remembers_where_and_how_much(fuser):
    fuser.apply(_frame(PERSON, time_ns=7))
    (look,) = fuser.looks
    np.testing.assert_allclose(look.intersection_enu, [0.1, 14.9, 0.0], atol=0.02)
    np.testing.assert_array_equal(look.camera_enu, POSE.position_enu)
    assert (look.time_ns, look.stream, look.detector, look.score) == (7, "a", "d", 0.8)
    # the centre of the box is 35 px above the axis
    assert math.asin(look.center_ray_enu[2]) == pytest.approx(-math.pi / 4.0 + math.atan(35.0 / 900.0))


def test_the_centre_can_be_the_significant_point(plane, params, camera):
    fuser = Fuser(plane, params.model_copy(update={"significant_point": "center"}), {"a": camera}, {"d": 1.0})
    fuser.apply(_frame(PERSON))
    away = 15.0 / math.tan(math.pi / 4.0 - math.atan(35.0 / 900.0))
    assert fuser.looks[0].intersection_enu[1] == pytest.approx(-0.1 + away, abs=0.02)


def test_a_frame_without_detections_lowers_what_it_sees_and_nothing_else(fuser, camera, params):
    fuser.apply(_frame())
    seen = fuser.map.observations > 0
    assert (fuser.map.log_odds[seen] < 0.0).all()
    assert (fuser.map.log_odds[~seen] == 0.0).all()
    assert (fuser.map.observations[seen] == 1).all()
    row, column = _cell(fuser, 0.1, 14.9)
    center = fuser.map.terrain.centers(np.array([row]), np.array([column]))[0]
    distance = np.array(math.dist(center, POSE.position_enu))
    expected = float(log_odds(SensorModel(camera, params).negative(distance, 1.0)))
    assert fuser.map.log_odds[row, column] == pytest.approx(expected, rel=1e-5)


def test_what_lies_behind_a_box_is_not_lowered(fuser):
    fuser.apply(_frame(PERSON))
    assert fuser.map.observations[_cell(fuser, 0.1, 15.9)] == 0
    assert fuser.map.observations[_cell(fuser, 3.1, 15.9)] == 1


def test_frames_that_show_the_feet_alone_do_not_erase_a_person(fuser, camera):
    fuser.apply(_frame(PERSON))
    person = _cell(fuser, 0.1, 14.9)
    found = fuser.map.log_odds[person]
    for pitch_deg in (-60.0, -62.0):
        pose = CameraPose(POSE.position_enu, enu_from_camera(0.0, math.radians(pitch_deg), 0.0))
        foot, head = camera.project_enu(np.array([[0.1, 14.9, 0.0], [0.1, 14.9, 1.7]]), pose)
        assert foot[1] > 0.0 > head[1]
        fuser.apply(_frame(pose=pose))
    assert fuser.map.log_odds[person] == found


def test_a_raised_voxel_is_not_lowered_by_the_same_frame(fuser):
    fuser.apply(_frame(PERSON))
    assert fuser.map.observations[_cell(fuser, 0.1, 14.9)] == 1


def test_a_less_accurate_detector_says_less(plane, params, camera):
    maps = []
    for detector in ("d", "half"):
        fuser = Fuser(plane, params, {"a": camera}, {"d": 1.0, "half": 0.5})
        fuser.apply(_frame(PERSON, detector=detector))
        maps.append(fuser.map.log_odds)
    assert (np.abs(maps[1]) <= np.abs(maps[0])).all()
    assert maps[1].max() < maps[0].max()


def test_the_same_results_give_the_same_bytes(plane, params, camera):
    runs = []
    for _ in range(2):
        fuser = Fuser(plane, params, {"a": camera}, {"d": 1.0})
        for i in range(5):
            fuser.apply(_frame(PERSON, (100.0 + i, 100.0, 130.0, 180.0), time_ns=i))
        runs.append(fuser.map.log_odds.tobytes())
    assert runs[0] == runs[1]


@pytest.mark.parametrize(
    ("box", "reason"),
    [
        ((0.5, 218.0, 50.0, 288.0), "cut by the picture's border"),
        ((487.0, 518.0, 537.0, 580.0), "cut by the picture's border"),
        ((500.0, 287.0, 501.0, 288.0), "not the size of its class, or no trust"),
        ((300.0, 10.0, 900.0, 500.0), "not the size of its class, or no trust"),
    ],
)
def test_a_box_without_a_place_raises_nothing_and_is_counted(fuser, box, reason):
    fuser.apply(_frame(box))
    assert (fuser.map.log_odds <= 0.0).all()
    assert fuser.looks == []
    assert fuser.unplaced == {reason: 1}
    assert not fuser.refused


def test_a_box_in_the_sky_has_no_place(fuser):
    level = CameraPose(POSE.position_enu, enu_from_camera(0.0, 0.0, 0.0))
    fuser.apply(_frame((487.0, 200.0, 537.0, 250.0), pose=level))
    assert fuser.unplaced == {"no ground within reach": 1}


def test_a_box_on_unknown_ground_has_no_place(fuser):
    fuser.map.terrain.heights_m[100:, :] = np.nan
    fuser.apply(_frame(PERSON))
    assert fuser.unplaced == {"no ground within reach": 1}


def _posed(position, rotation=POSE.enu_from_camera):
    return CameraPose(np.array(position, dtype=np.float64), np.array(rotation, dtype=np.float64))


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (_frame(PERSON, stream="x"), "unknown stream"),
        (_frame(PERSON, detector="x"), "unknown detector"),
        (_frame(PERSON, scores=[0.5, 0.5]), "boxes and scores of different number"),
        (_frame(PERSON, pose=_posed([np.nan, 0.0, 15.0])), "pose with NaN"),
        (_frame(PERSON, pose=_posed([0.0, 0.0, 15.0], np.full((3, 3), np.nan))), "pose with NaN"),
        (_frame(PERSON, pose=_posed([0.0, 0.0, 15.0], np.ones((3, 3)))), "attitude that is no rotation"),
        (_frame(PERSON, pose=_posed([0.0, 0.0, 15.0], -np.eye(3))), "attitude that is no rotation"),
        (_frame(PERSON, pose=_posed([41.0, 0.0, 15.0])), "pose outside the terrain"),
        (_frame(PERSON, pose=_posed([0.0, 0.0, -0.1])), "pose under the ground"),
        *(
            (_frame(PERSON, pose=replace(POSE, **{name: value})), "impossible standard deviation")
            for name in ("horizontal_sd_m", "height_sd_m", "attitude_sd_rad")
            for value in (-1e-9, -5.0, np.inf, -np.inf)
        ),
    ],
)
def test_a_bad_result_is_counted_and_leaves_the_map_as_it_was(fuser, frame, reason):
    fuser.apply(frame)
    assert fuser.refused == {reason: 1}
    assert not fuser.map.observations.any()


@pytest.mark.parametrize(
    ("box", "score", "reason"),
    [
        ((np.nan, 218.0, 537.0, 288.0), 0.8, "box with NaN"),
        ((537.0, 218.0, 487.0, 288.0), 0.8, "box without area"),
        ((487.0, 218.0, 487.0, 288.0), 0.8, "box without area"),
        ((1100.0, 218.0, 1150.0, 288.0), 0.8, "box outside the picture"),
        ((-50.0, 218.0, -1.0, 288.0), 0.8, "box outside the picture"),
        (PERSON, 1.1, "score outside 0..1"),
        (PERSON, -0.1, "score outside 0..1"),
        (PERSON, float("nan"), "score outside 0..1"),
    ],
)
def test_a_bad_box_is_counted_and_the_rest_of_its_frame_is_used(plane, params, camera, box, score, reason):
    other = (100.0, 100.0, 150.0, 180.0)
    with_bad, without = (Fuser(plane, params, {"a": camera}, {"d": 1.0}) for _ in range(2))
    with_bad.apply(_frame(box, other, scores=[score, 0.9]))
    without.apply(_frame(other, scores=[0.9]))
    assert with_bad.refused == {reason: 1}
    np.testing.assert_array_equal(with_bad.map.log_odds, without.map.log_odds)


def test_a_relative_accuracy_above_one_is_refused(plane, params, camera):
    with pytest.raises(InputError, match="relative accuracy of d"):
        Fuser(plane, params, {"a": camera}, {"d": 1.2})


def test_sure_boxes_are_measured_against_people_at_their_places(fuser):
    fuser.apply(_frame(PERSON, PERSON, scores=[0.8, 0.3]))
    # 21.2 m away, 45 degrees down: f / d * sqrt((1.7 cos + 0.5 sin) 0.5) = 37.4 px; the box 50 x 70 px
    expected_px = 900.0 / (15.0 * math.sqrt(2.0)) * math.sqrt((1.7 + 0.5) * math.sqrt(0.5) * 0.5)
    assert dict(fuser.sizes) == {("a", size_bin(math.sqrt(50.0 * 70.0), expected_px)): 1}


def test_a_height_told_twice_as_great_doubles_the_measured_size(fuser):
    higher = CameraPose(np.array([0.1, -0.1, 30.0]), POSE.enu_from_camera)
    fuser.apply(_frame(PERSON))
    fuser.apply(_frame(PERSON, pose=higher, time_ns=2))
    first, second = sorted(size for _, size in fuser.sizes)
    assert (second - first) / BINS == pytest.approx(math.log(2.0), abs=1.5 / BINS)


def test_where_it_is_known_who_would_have_been_found_that_lowers_and_is_the_pod(plane, params, camera):
    model = SubstreamModel(1.0, 0.3, (4.0, 30.0, 90.0), (0.0, 0.5, 0.9), camera.width)
    with_uncertainty = params.model_copy(update={"update_rule": "with_uncertainty"})
    fuser = Fuser(plane, with_uncertainty, {"a": camera}, {"d": 1.0}, substreams={("a", "d"): model})
    fuser.apply(_frame())
    row, column = _cell(fuser, 0.1, 14.9)
    center = plane.centers(np.array([row]), np.array([column]))[0]
    person_px = 900.0 * math.sqrt(1.7 * 0.5) / math.dist(center, POSE.position_enu)
    found = float(model.probability_found(np.array([person_px]), camera.width)[0])
    assert 0.5 < found < 0.9
    less = params.negative_max * found
    expected = math.log((0.5 - less) / (0.5 + less))
    assert float(fuser.map.log_odds[row, column]) == pytest.approx(expected, rel=5e-3)
    assert float(fuser.map.pod[row, column]) == pytest.approx(found, rel=5e-3)


def test_the_papers_rule_knows_no_substreams(plane, params, camera):
    model = SubstreamModel(0.1, 0.1, (4.0, 30.0), (0.0, 0.5), camera.width)
    plain = Fuser(plane, params, {"a": camera}, {"d": 1.0})
    told = Fuser(plane, params, {"a": camera}, {"d": 1.0}, substreams={("a", "d"): model})
    for fuser in (plain, told):
        fuser.apply(_frame(PERSON))
    np.testing.assert_array_equal(told.map.log_odds, plain.map.log_odds)


def test_frames_that_share_a_cause_make_the_pod_grow_as_their_share_says(plane, params, camera):
    model = SubstreamModel(1.0, 1.0, (4.0, 5.0), (0.0, 0.4), camera.width)
    uncertain = params.model_copy(update={"update_rule": "with_uncertainty"})
    fuser = Fuser(plane, uncertain, {"a": camera}, {"d": 1.0}, substreams={("a", "d"): model})
    for k in range(5):
        fuser.apply(_frame(time_ns=1 + k * 10**8))
    share = math.tanh(0.1 / (2.0 * uncertain.uncertainty.cause_time))
    pod = float(fuser.map.pod[_cell(fuser, 0.1, 14.9)])
    assert pod == pytest.approx(1.0 - 0.6 ** (1.0 + 4.0 * share), rel=1e-3)


def test_what_raises_and_what_lowers_are_two_worths(plane, params, camera):
    exact = params.model_copy(update={"update_rule": "with_uncertainty", "uncertainty": EXACT})
    worth = {("a", "d"): SubstreamModel(raises=0.9, lowers=0.2)}
    fuser = Fuser(plane, exact, {"a": camera}, {"d": 0.5}, substreams=worth)
    fuser.apply(_frame(PERSON))
    model, distance = SensorModel(camera, params), 15.0 * math.sqrt(2.0)
    assert fuser.looks[0].p == pytest.approx(model.positive(np.array(PERSON), 0.8, distance, 0.9), abs=1e-3)
    row, column = _cell(fuser, 5.1, 14.9)
    center = plane.centers(np.array([row]), np.array([column]))[0]
    away = np.array(math.dist(center, POSE.position_enu))
    assert float(fuser.map.log_odds[row, column]) == pytest.approx(
        float(log_odds(model.negative(away, 0.2))), rel=1e-4
    )


def test_the_width_of_a_look_is_of_the_cameras_pixels_and_focal_length(plane, params, camera, monkeypatch):
    """As the camera is zoomed, with its own uncertainty."""
    asked, real = [], fuser_module.look_covariances
    monkeypatch.setattr(fuser_module, "look_covariances", lambda *given: asked.append(given) or real(*given))
    unsure = replace(camera, focal_sd=0.07)
    uncertain = params.model_copy(update={"update_rule": "with_uncertainty"})
    fuser = Fuser(plane, uncertain, {"a": unsure}, {"d": 1.0})
    zoomed = replace(POSE, focal_scale=1.25)
    fuser.apply(_frame(PERSON, pose=zoomed))
    ((points, pose, uncertainty, pixel_rad, focal_sd),) = asked
    np.testing.assert_array_equal(points, [fuser.looks[0].intersection_enu])
    assert pose is zoomed
    assert uncertainty == uncertain.uncertainty
    assert (pixel_rad, focal_sd) == (pytest.approx(1.0 / (900.0 * 1.25)), 0.07)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_who_is_found_follows_the_pictures_width_and_the_zoom(plane, params, camera, factor):
    """A picture half as wide with half the focal length, or a zoom: what counts is the evaluation's pixels."""
    model = SubstreamModel(1.0, 1.0, (4.0, 30.0, 200.0), (0.0, 0.3, 0.9), camera.width)
    uncertain = params.model_copy(update={"update_rule": "with_uncertainty"})

    def pod(lens, pose=POSE):
        fuser = Fuser(plane, uncertain, {"a": lens}, {"d": 1.0}, substreams={("a", "d"): model})
        fuser.apply(_frame(pose=POSE))
        fuser.apply(_frame(pose=pose, time_ns=10**12))
        return float(fuser.map.pod[_cell(fuser, 0.1, 14.9)])

    scaled = {name: getattr(camera, name) * factor for name in ("fx", "fy", "cx", "cy")}
    size = {"width": round(camera.width * factor), "height": round(camera.height * factor)}
    assert pod(replace(camera, **scaled, **size)) == pytest.approx(pod(camera), rel=5e-3)
    zoomed = pod(camera, replace(POSE, focal_scale=factor))
    assert (zoomed > pod(camera) + 0.02) if factor > 1.0 else (zoomed < pod(camera) - 0.02)

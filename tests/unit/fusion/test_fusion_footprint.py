"""What a look raises and shields when it is known only roughly where it points."""

import dataclasses
import math

import numpy as np
import pytest

from pipeline.fusion.footprint import footprints
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.salient import salient_locations
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections

PLANE = Terrain(LocalFrame(47.0, 8.0), -40.0, -40.0, 0.5, np.zeros((160, 160), dtype=np.float32))
DOWN = enu_from_camera(0.0, -math.pi / 2.0, 0.0)
P = np.array([0.8])


def _weights(point, noise, total=None, terrain=PLANE):
    """raised and shielded of one look, as pictures of the whole terrain."""
    noise = np.asarray(noise, dtype=np.float64)
    made = footprints(terrain, np.array([point]), noise[None], (noise if total is None else total)[None], P)
    row, column, rows, columns = made.windows[0]
    pictures = []
    for weights in (made.raised, made.shielded):
        picture = np.zeros(terrain.shape)
        picture[row : row + rows, column : column + columns] = weights.reshape(rows, columns)
        pictures.append(picture)
    return pictures


def test_without_width_the_cell_of_the_point_alone_counts():
    raised, shielded = _weights((0.1, 0.1), np.zeros((2, 2)))
    row, column = PLANE.cell(0.1, 0.1)
    assert raised[row, column] == shielded[row, column] == 1.0
    assert raised.sum() == shielded.sum() == 1.0


def test_the_weight_is_the_density_over_its_geometric_mean_among_true_looks():
    covariance = np.array([[1.0, 0.3], [0.3, 0.5]])
    raised, _ = _weights((0.1, 0.2), covariance)
    rng = np.random.default_rng(3)
    draws = rng.multivariate_normal((0.0, 0.0), covariance, 100_000)
    inverse = np.linalg.inv(covariance)
    log_density = -0.5 * np.einsum("ni,ij,nj->n", draws, inverse, draws)
    for east, north in ((3.0, 0.2), (0.1, -2.0), (1.8, 1.6)):
        row, column = PLANE.cell(east, north)
        corner = np.array([-40.0 + column * 0.5, -40.0 + row * 0.5])
        offset = np.clip((0.1, 0.2), corner, corner + 0.5) - (0.1, 0.2)
        expected = math.exp(-0.5 * offset @ inverse @ offset - log_density.mean())
        assert raised[row, column] == pytest.approx(min(1.0, expected), rel=0.02)


def test_the_window_holds_every_weight_that_counts():
    raised, _ = _weights((0.1, 0.2), np.diag([4.0, 0.01]))
    ring = raised[:, PLANE.cell(8.0, 0.2)[1]]
    assert ring.max() < 2e-3
    assert raised[PLANE.cell(5.0, 0.2)] > 0.05
    assert (raised[raised > 0.0] >= 1e-3).all()


def test_a_footprint_at_the_edge_of_the_terrain_and_over_a_hole_keeps_to_the_voxels():
    heights = np.zeros((160, 160), dtype=np.float32)
    heights[0, 3] = math.nan
    holed = Terrain(LocalFrame(47.0, 8.0), -40.0, -40.0, 0.5, heights)
    raised, _ = _weights((-39.9, -39.9), np.eye(2), terrain=holed)
    assert raised[0, 3] == 0.0
    assert raised[0, 0] == raised[0, 2] == 1.0


def _noisy(params, **uncertainty):
    changed = params.uncertainty.model_copy(
        update=dict.fromkeys(("position_bias", "height_bias", "attitude_bias", "attitude_noise"), 0.0)
        | {"cause_time": 0.0}
        | uncertainty
    )
    return params.model_copy(update={"uncertainty": changed, "update_rule": "with_uncertainty"})


def _frame(at, time_ns, *places, stream="a", score=0.8, shift=(0.0, 0.0)):
    """A camera 20 m over at; boxes of people at places; the pose is told wrong by shift."""
    seen = CameraPose(np.array([at[0] + shift[0], at[1] + shift[1], 20.0]), DOWN)
    feet = [(512.0 + 45.0 * (e - at[0]), 288.0 - 45.0 * (n - at[1])) for e, n in places]
    boxes = [[u - 20.0, v - 40.0, u + 20.0, v] for u, v in feet]
    count = len(boxes)
    return Detections(
        stream, "d", time_ns, time_ns, seen,
        np.array(boxes).reshape(count, 4), np.full(count, score), np.zeros(count, np.int64),
    )  # fmt: skip


def test_a_person_whose_looks_scatter_over_the_cells_is_one_place(params, camera):
    noisy = _noisy(params, position_noise=0.5)
    rng = np.random.default_rng(4)
    shifts = [rng.normal(size=2) * 0.5 for _ in range(30)]
    found = {}
    for name, chosen in (("with width", noisy), ("paper", params)):
        fuser = Fuser(PLANE, chosen, {"a": camera}, {"d": 1.0})
        for k, shift in enumerate(shifts):
            people = [(0.0, 0.0)] if k % 2 else []
            fuser.apply(_frame((0.0, 0.0), k * 10**9, *people, score=0.6, shift=shift))
        found[name] = salient_locations(fuser.map, fuser.looks, chosen)
    assert found["paper"] == ()
    (place,) = found["with width"]
    assert math.hypot(*place.position_enu[:2]) < 0.5


@pytest.mark.parametrize("name", ["horizontal_sd_m", "height_sd_m", "attitude_sd_rad"])
def test_by_the_papers_rule_the_errors_that_telemetry_states_change_no_bit(params, camera, name):
    maps = []
    for sd in (math.nan, 0.3):
        fuser = Fuser(PLANE, params, {"a": camera}, {"d": 1.0})
        for k in range(6):
            frame = _frame((0.3 * k, 0.0), k * 10**9, (0.0, 0.0), (3.0, 1.0))
            fuser.apply(dataclasses.replace(frame, pose=dataclasses.replace(frame.pose, **{name: sd})))
        maps.append(fuser.map.log_odds.tobytes())
    assert params.update_rule == "paper"
    assert maps[0] == maps[1]


def test_another_streams_bias_does_not_lower_what_it_sees_itself(params, camera):
    biased = _noisy(params, position_bias=1.3)
    blind = biased.model_copy(
        update={"uncertainty": biased.uncertainty.model_copy(update={"position_bias": 0.0})}
    )
    change = {}
    for name, chosen in (("told", biased), ("not told", blind)):
        fuser = Fuser(PLANE, chosen, {"a": camera, "b": camera}, {"d": 1.0})
        fuser.apply(_frame((0.0, 0.0), 0, (0.0, 0.0), stream="a"))
        before = float(fuser.map.log_odds[PLANE.cell(0.1, 0.1)])
        fuser.apply(_frame((0.0, 0.0), 1, (0.0, 0.0), stream="b", shift=(1.2, 0.0)))
        change[name] = float(fuser.map.log_odds[PLANE.cell(0.1, 0.1)]) - before
    assert before > 0.5
    assert change["not told"] < -0.1
    assert abs(change["told"]) < 0.01


def test_boxes_known_too_badly_raise_nothing_and_are_counted(params, camera):
    vague = _noisy(params, position_noise=6.0)
    fuser = Fuser(PLANE, vague, {"a": camera}, {"d": 1.0})
    fuser.apply(_frame((0.0, 0.0), 0, (0.0, 0.0)))
    assert fuser.unplaced["known too badly where"] == 1
    assert not fuser.looks
    assert (fuser.map.log_odds <= 0.0).all()


def test_frames_that_share_a_cause_count_as_the_effective_number_of_looks(params, camera):
    cause = _noisy(params, cause_time=0.5)
    fuser = Fuser(PLANE, cause, {"a": camera}, {"d": 1.0})
    lowered = []
    for k in range(3):
        before = float(fuser.map.log_odds[PLANE.cell(0.1, 0.1)])
        fuser.apply(_frame((0.0, 0.0), k * 10**8))
        lowered.append(float(fuser.map.log_odds[PLANE.cell(0.1, 0.1)]) - before)
    r = math.exp(-0.1 / 0.5)
    assert lowered[1] == pytest.approx(lowered[0] * (1.0 - r) / (1.0 + r), rel=1e-4)
    assert lowered[2] == pytest.approx(lowered[1], rel=1e-4)


def test_another_detector_on_the_same_frame_is_a_look_of_its_own(params, camera):
    cause = _noisy(params, cause_time=0.5)
    fuser = Fuser(PLANE, cause, {"a": camera}, {"d": 1.0, "e": 1.0})
    fuser.apply(_frame((0.0, 0.0), 0))
    once = float(fuser.map.log_odds[PLANE.cell(0.1, 0.1)])
    other = _frame((0.0, 0.0), 0)
    fuser.apply(
        Detections(
            other.stream,
            "e",
            *(getattr(other, f) for f in ("index", "time_ns", "pose", "boxes_px", "scores", "class_ids")),
        )
    )
    assert float(fuser.map.log_odds[PLANE.cell(0.1, 0.1)]) == pytest.approx(2.0 * once, rel=1e-5)


def test_two_people_in_one_footprint_are_not_counted_twice_in_a_cell(params, camera):
    noisy = _noisy(params, position_noise=0.5)
    one, two = (Fuser(PLANE, noisy, {"a": camera}, {"d": 1.0}) for _ in range(2))
    one.apply(_frame((0.0, 0.0), 0, (0.0, 0.0)))
    two.apply(_frame((0.0, 0.0), 0, (0.0, 0.0), (0.4, 0.0)))
    assert float(two.map.log_odds.max()) == pytest.approx(float(one.map.log_odds.max()), rel=1e-2)

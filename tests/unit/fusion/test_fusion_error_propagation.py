"""The propagation against moving the looks themselves, and what averages away and what does not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.bench_error_ellipse import BUDGETS, coverage
from benchmarks.bench_error_ellipse import params as with_budget

from pipeline.config.uncertainty import Uncertainty
from pipeline.fusion.error_propagation import _markov, place_covariance, variance_factor
from pipeline.fusion.localization import GROUND_STD_M, locate
from pipeline.fusion.look import Look
from pipeline.geo.pose import enu_from_camera

RTK, PLAIN = list(BUDGETS)[:2]

NOTHING = Uncertainty().model_copy(
    update=dict.fromkeys(Uncertainty.model_fields, 0.0) | {"correlation_time": 2.0}
)


DOWN = (0.0, math.radians(-45.0), 0.0)


def look(south_m, angles_rad=DOWN, camera_offset=(0.0, 0.0, 0.0), time_ns=0):
    """Of a body whose middle is 0.4 m above (0, 0), from 15 m up; the pose may be told wrongly."""
    true_camera, body = np.array([1.0, -south_m, 15.0]), np.array([0.0, 0.0, 0.4])
    true = enu_from_camera(0.0, math.radians(-45.0), 0.0)
    told, camera = enu_from_camera(*angles_rad), true_camera + np.array(camera_offset)
    center = told @ true.T @ (body - true_camera)
    foot = told @ true.T @ (np.array([0.0, -0.2, 0.0]) - true_camera)
    hit = camera + foot * (camera[2] / -foot[2])
    ray = center / np.linalg.norm(center)
    return Look(time_ns, "a", "d", 0.9, 0.8, 0, 0, hit, camera, ray, told, 1.0 / 900.0)


def passing(count=30, **changes):
    souths = np.linspace(26.0, 9.0, count)
    return [look(s, time_ns=i * 200_000_000, **changes) for i, s in enumerate(souths)]


def only(**changes):
    return NOTHING.model_copy(update=changes)


def bias_part(uncertainty):
    """Without the estimator's own allowance for the ground point."""
    return place_covariance(passing(), uncertainty) - place_covariance(passing(), NOTHING)


def test_a_shared_shift_of_the_camera_moves_the_place_by_as_much():
    variance = bias_part(only(position_bias=1.3))
    np.testing.assert_allclose(variance, 1.3**2 * np.eye(2), atol=1e-6)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_shared_turn_moves_the_place_as_moving_the_looks_does(axis):
    angle = 1e-4
    turned = np.array([0.0, math.radians(-45.0), 0.0])
    turned[axis] += angle
    moved = (locate(passing(angles_rad=tuple(turned))) - locate(passing())) / angle
    effects = bias_part(only(attitude_bias=1.0))
    # the sum over yaw, pitch and roll of the outer products of what each does
    assert effects[0, 0] + effects[1, 1] >= moved @ moved * 0.99
    total = np.zeros((2, 2))
    for k in range(3):
        angles = np.array([0.0, math.radians(-45.0), 0.0])
        angles[k] += angle
        effect = (locate(passing(angles_rad=tuple(angles))) - locate(passing())) / angle
        total += np.outer(effect, effect)
    np.testing.assert_allclose(effects, total, rtol=0.05, atol=1.0)


def test_a_shared_rise_of_the_camera_moves_the_place_as_moving_the_looks_does():
    moved = locate(passing(camera_offset=(0.0, 0.0, 0.01))) - locate(passing())
    np.testing.assert_allclose(bias_part(only(height_bias=0.01)), np.outer(moved, moved), atol=1e-9)


def test_many_looks_average_noise_but_no_bias():
    few, many = passing(10), passing(160)
    for name, shrinks in (("box", True), ("position_bias", False)):
        traces = [
            np.trace(place_covariance(k, only(**{name: 2.0})) - place_covariance(k, NOTHING))
            for k in (few, many)
        ]
        assert (traces[1] < traces[0] / 8.0) == shrinks
        assert shrinks or traces[1] == pytest.approx(traces[0], rel=0.02)


def test_a_single_look_is_as_uncertain_as_its_ground_point():
    covariance = place_covariance([look(15.0)], NOTHING)
    # across the line of sight the ray fixes the place; along it only the ground point does
    assert covariance[1, 1] == pytest.approx(GROUND_STD_M**2, rel=0.02)


def stated(looks, **sds):
    return [replace(k, **sds) for k in looks]


def test_what_the_telemetry_states_takes_the_place_of_the_missions_own():
    mission = only(position_bias=1.3, height_bias=2.0, attitude_bias=0.01)
    own = only(position_bias=0.1, height_bias=4.0, attitude_bias=0.003)
    looks = stated(passing(), horizontal_sd_m=0.1, height_sd_m=4.0, attitude_sd_rad=0.003)
    np.testing.assert_allclose(place_covariance(looks, mission), place_covariance(passing(), own), rtol=1e-9)
    assert variance_factor(looks, mission) == pytest.approx(variance_factor(passing(), own))


def test_what_is_not_stated_stays_the_missions_to_the_last_bit():
    mission = only(position_bias=1.3, height_bias=2.0)
    part = stated(passing(), horizontal_sd_m=5.0)
    np.testing.assert_allclose(
        place_covariance(part, mission), place_covariance(passing(), only(position_bias=5.0, height_bias=2.0))
    )
    silent = stated(passing(), horizontal_sd_m=math.nan)
    assert (place_covariance(silent, mission) == place_covariance(passing(), mission)).all()


def test_a_look_that_is_less_sure_of_itself_widens_the_ellipse_of_all():
    some = [replace(k, horizontal_sd_m=10.0 if i % 3 else math.nan) for i, k in enumerate(passing())]
    covariances = [place_covariance(k, only(position_bias=1.0)) for k in (passing(), some)]
    assert 1.0 < np.sqrt(covariances[1][0, 0] / covariances[0][0, 0]) < 10.0


def test_looks_that_scatter_more_than_was_stated_widen_the_ellipse():
    rng = np.random.default_rng(3)
    shaken = [replace(k, camera_enu=k.camera_enu + rng.normal(0.0, 0.5, 3)) for k in passing()]
    stated = only(position_noise=0.1, correlation_time=0.001)
    assert variance_factor(passing(), stated) == 1.0
    assert variance_factor(shaken, stated) > 10.0
    assert np.trace(place_covariance(shaken, stated)) > np.trace(place_covariance(passing(), stated))


def test_the_sum_over_correlated_times_is_that_of_all_pairs():
    rng = np.random.default_rng(4)
    effect, times = rng.normal(size=(20, 2, 3)), np.sort(rng.uniform(0.0, 9.0, 20))
    pairs = np.exp(-np.abs(times[:, None] - times) / 2.0)
    np.testing.assert_allclose(
        _markov(effect, times, 2.0), np.einsum("nm,nik,mjk->ij", pairs, effect, effect)
    )


@pytest.mark.parametrize("name", [RTK, pytest.param(PLAIN, marks=pytest.mark.slow)])
def test_the_true_place_lies_in_the_95_percent_ellipse_in_90_to_99_of_100_cases(name):
    measured = coverage(with_budget(BUDGETS[name]), missions=28, seed=1)
    assert measured.places >= 30
    assert 0.90 <= measured.share <= 0.99


def test_a_stand_in_for_the_terrain_is_as_unsure_as_a_terrain_of_that_deviation():
    sure, looks = passing(), [replace(k, terrain_sd_m=3.0) for k in passing()]
    nothing = place_covariance(sure, NOTHING)
    whole = place_covariance(sure, only(terrain=3.0)) - nothing
    np.testing.assert_allclose(place_covariance(looks, NOTHING) - nothing, whole, rtol=1e-9)
    half = place_covariance([*sure[:15], *looks[15:]], NOTHING) - nothing
    assert 0.0 < half[1, 1] < whole[1, 1]
    both = place_covariance(looks, only(terrain=4.0)) - nothing
    np.testing.assert_allclose(both, whole * 25.0 / 9.0, rtol=1e-9)

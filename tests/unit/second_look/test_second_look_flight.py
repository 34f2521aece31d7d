import itertools

import numpy as np
import pytest

from pipeline.config.second_look import SecondLook
from pipeline.geo.frame import LocalFrame
from pipeline.geo.terrain import Terrain
from pipeline.second_look.areas import SecondLookArea
from pipeline.second_look.clearance import clearance_of
from pipeline.second_look.flight import STEP_M, footprint_m, plan_second_flight, visiting_order

PARAMS = SecondLook()
HOME = np.array([-30.0, -30.0])


def area(number, east, north, width, depth):
    """A rectangle by its middle."""
    x = np.arange(east - width / 2.0 + 0.25, east + width / 2.0, 0.5)
    y = np.arange(north - depth / 2.0 + 0.25, north + depth / 2.0, 0.5)
    cells = np.stack([grid.ravel() for grid in np.meshgrid(x, y)], axis=1)
    return SecondLookArea(number, {"why": 1.0}, width * depth, 1.0, (cells[:1],), cells)


@pytest.fixture
def hilly():
    north, east = np.mgrid[:160, :160] * 0.5
    heights = 100.0 + 4.0 * np.sin(east / 9.0) + 3.0 * np.cos(north / 13.0)
    heights[70:80, 70:80] += 6.0  # a house
    return Terrain(LocalFrame(47.0, 8.0), -40.0, -40.0, 0.5, heights.astype(np.float32))


def test_without_areas_nobody_flies(camera, hilly):
    flight = plan_second_flight((), camera, hilly, HOME, PARAMS)
    assert (flight.waypoints, flight.length_m, flight.duration_s) == ((), 0.0, 0.0)


def test_a_small_area_gets_one_point_to_hover_at(camera, hilly):
    flight = plan_second_flight([area(1, 5.0, 5.0, 3.0, 3.0)], camera, hilly, HOME, PARAMS)
    (stop,) = [w for w in flight.waypoints if w.hover_s > 0.0]
    assert (stop.area, stop.hover_s) == (1, PARAMS.hover)
    np.testing.assert_allclose(stop.position_enu[:2], [5.0, 5.0], atol=1e-9)


@pytest.mark.parametrize(("width", "depth"), [(30.0, 8.0), (12.0, 40.0), (34.0, 30.0)])
def test_every_cell_of_a_large_area_comes_under_the_camera(camera, hilly, width, depth):
    large = area(1, 2.0, 3.0, width, depth)
    flight = plan_second_flight([large], camera, hilly, HOME, PARAMS)
    over = np.array([w.position_enu[:2] for w in flight.waypoints if w.area == 1])
    way = np.concatenate([np.linspace(a, b, 40) for a, b in itertools.pairwise(over)])
    apart = np.linalg.norm(large.cells_enu[:, None] - way[None], axis=2).min(axis=1)
    assert apart.max() <= footprint_m(camera, PARAMS.height)[0] / 2.0 + 0.3


def test_the_way_is_always_high_enough_above_the_surface(camera, hilly):
    both = [area(1, -20.0, 20.0, 30.0, 10.0), area(2, 25.0, 25.0, 4.0, 4.0)]
    flight = plan_second_flight(both, camera, hilly, HOME, PARAMS)
    points = np.array([w.position_enu for w in flight.waypoints])
    assert np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1).max() <= STEP_M + 1e-9
    for start, end in itertools.pairwise(points):
        for spot in np.linspace(start, end, 12):
            assert spot[2] - hilly.height(spot[0], spot[1]) >= PARAMS.height - 1e-3


def test_its_heights_count_from_where_the_telemetry_says_that_it_took_off(camera, hilly):
    small = [area(1, 5.0, 5.0, 3.0, 3.0)]
    told = plan_second_flight(small, camera, hilly, HOME, PARAMS, takeoff_m=80.0)
    assumed = plan_second_flight(small, camera, hilly, HOME, PARAMS)
    ground = hilly.height(*HOME)
    assert (told.takeoff_m, told.takeoff_is_told) == (80.0, True)
    assert told.takeoff_below_home_m == pytest.approx(ground - 80.0)
    assert (assumed.takeoff_m, assumed.takeoff_is_told) == (pytest.approx(ground), False)
    highest = max(w.position_enu[2] for w in told.waypoints)
    assert told.climb_m == pytest.approx(highest - 80.0)
    assert assumed.climb_m == pytest.approx(highest - ground)


def test_the_whole_way_is_checked_against_the_terrain(camera, hilly):
    flight = plan_second_flight([area(1, -20.0, 20.0, 30.0, 10.0)], camera, hilly, HOME, PARAMS)
    assert PARAMS.height - 1e-2 <= flight.clearance.least_m < PARAMS.height + 5.0
    assert flight.clearance.unknown_m == 0.0


@pytest.mark.parametrize(
    ("east", "north", "least_m"), [(0.0, 0.0, 15.0), (10.2, 3.0, 5.0), (9.5, 3.2, 5.0), (20.0, 7.0, 15.0)]
)
def test_a_post_under_a_leg_is_found_and_one_beside_it_is_not(east, north, least_m):
    """One cell of 0.5 m that is 10 m high, half way along a leg of 40 m at 15 m."""
    heights = np.zeros((80, 120), dtype=np.float32)
    terrain = Terrain(LocalFrame(47.0, 8.0), -10.0, -10.0, 0.5, heights)
    row, column = terrain.cell(east, north)
    heights[row, column] = 10.0
    legs = np.array([[-5.0, 3.0, 15.0], [35.0, 3.0, 15.0]])
    assert clearance_of(legs, terrain).least_m == pytest.approx(least_m)


def test_what_leads_over_unknown_ground_is_told():
    heights = np.zeros((40, 80), dtype=np.float32)
    heights[:, 20:40] = np.nan  # 10 m of 40
    terrain = Terrain(LocalFrame(47.0, 8.0), 0.0, 0.0, 0.5, heights)
    legs = np.array([[1.0, 5.0, 15.0], [39.0, 5.0, 15.0], [39.0, 60.0, 15.0]])
    checked = clearance_of(legs, terrain)
    assert checked.unknown_m == pytest.approx(9.0 + 40.0, abs=1.0)
    assert checked.least_m == pytest.approx(15.0)
    assert clearance_of(legs[:1] - 100.0, terrain).least_m == np.inf


def test_it_ends_above_home_and_its_length_is_that_of_its_legs(camera, hilly):
    flight = plan_second_flight([area(1, 5.0, 5.0, 3.0, 3.0)], camera, hilly, HOME, PARAMS)
    np.testing.assert_allclose(flight.waypoints[-1].position_enu[:2], HOME)
    points = [flight.home_enu, *(w.position_enu for w in flight.waypoints), flight.home_enu]
    legs = [np.linalg.norm(b - a) for a, b in itertools.pairwise(points)]
    assert flight.length_m == pytest.approx(sum(legs))
    assert flight.duration_s == pytest.approx(sum(legs) / PARAMS.speed + PARAMS.hover)


@pytest.mark.parametrize("seed", range(8))
def test_the_order_is_within_a_tenth_of_the_shortest_round_trip(seed):
    rng = np.random.default_rng(seed)
    middles = {k: rng.uniform(-50.0, 50.0, 2) for k in range(1, 7)}

    def length(order):
        points = [HOME, *(middles[k] for k in order), HOME]
        return sum(np.linalg.norm(b - a) for a, b in itertools.pairwise(points))

    shortest = min(length(order) for order in itertools.permutations(middles))
    assert length(visiting_order(HOME, middles)) <= 1.1 * shortest

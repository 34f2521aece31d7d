"""Which places may be one person, how many people a place shows, and what is listed as possible."""

import itertools
import math
import tracemalloc

import numpy as np
import pytest

from pipeline.fusion.look import Look
from pipeline.fusion.one_person import expected_people, with_may_be
from pipeline.fusion.possible import found_and_possible
from pipeline.fusion.salient import salient_locations
from pipeline.fusion.sightings import count_frames, count_looks, people_at_once, seen_at_once
from pipeline.fusion.voxel_map import VoxelMap, log_odds
from pipeline.geo.pose import enu_from_camera

DOWN = enu_from_camera(0.0, math.radians(-90.0), 0.0)


def sighting(terrain, east, north, time_s=0.0, stream="a", p=0.8, box=0, detector="d"):
    """From 30 m straight above."""
    camera, point = np.array([east, north, 30.0]), np.array([east, north, 0.0])
    row, column = (int(k) for k in terrain.cells(point[None])[0])
    ray, ns = np.array([0.0, 0.0, -1.0]), int(time_s * 1e9)
    return Look(
        ns, stream, detector, 0.9, p, row, column, point, camera, ray, DOWN, 1.0 / 900.0, "person", box
    )


def raised(terrain, looks):
    voxel_map = VoxelMap(terrain, 0.1192, 0.971)
    rows, columns = (np.array([getattr(k, n) for k in looks], dtype=np.int64) for n in ("row", "column"))
    voxel_map.update(rows, columns, log_odds(np.array([k.p for k in looks])))
    return voxel_map


def places(terrain, looks, params):
    return with_may_be(salient_locations(raised(terrain, looks), looks, params), params.uncertainty)


def many(terrain, east, north, stream="a", start_s=0.0, count=5, box=0):
    return [sighting(terrain, east, north, start_s + 0.1 * k, stream, 0.65, box) for k in range(count)]


def test_two_streams_at_once_are_two_looks(plane):
    both = [sighting(plane, 0.0, 0.0, 0.1 * k, s) for k in range(20) for s in ("a", "b")]
    assert (count_looks(both), count_frames(both)) == (2, 40)
    again = [*both, sighting(plane, 0.0, 0.0, 9.0, "b"), sighting(plane, 0.0, 0.0, 9.9, "b")]
    assert count_looks(again) == 3


def test_two_detectors_of_one_frame_are_one_look_of_one_frame(plane):
    both = [sighting(plane, 0.0, 0.0, 0.1 * k, detector=d) for k in range(4) for d in ("m:n", "m:s")]
    assert (count_looks(both), count_frames(both)) == (1, 4)


def test_two_people_side_by_side_are_counted_and_a_stray_second_box_is_not(plane):
    two = many(plane, 0.0, 0.0) + many(plane, 0.6, 0.0, box=1)
    assert people_at_once(two) == 2
    assert people_at_once(many(plane, 0.0, 0.0, count=30) + many(plane, 0.1, 0.0, count=1, box=1)) == 1
    assert people_at_once(many(plane, 0.0, 0.0, count=30) + many(plane, 0.1, 0.0, count=2, box=1)) == 1
    assert people_at_once([]) == 1


def test_people_to_be_expected(plane, params):
    (both,) = places(plane, many(plane, 0.0, 0.0) + many(plane, 0.9, 0.0, box=1), params)
    assert both.people == 2
    assert both.expected_people == pytest.approx(2 * both.probability)


@pytest.mark.parametrize(
    ("apart_m", "streams", "may_be"),
    [(4.0, ("a", "b"), True), (4.0, ("a", "a"), False), (30.0, ("a", "b"), False)],
)
def test_streams_with_offsets_of_their_own_may_see_one_person_twice(plane, params, apart_m, streams, may_be):
    """Plain positioning: each stream is off by 1.3 m and more; but one stream is off by the same both times."""
    looks = many(plane, 0.0, 0.0, streams[0]) + many(plane, apart_m, 0.0, streams[1], 60.0)
    first, second = places(plane, looks, params)
    assert (first.may_be, second.may_be) == (((2,), (1,)) if may_be else ((), ()))


def test_who_is_seen_in_the_same_frames_is_somebody_else(plane, params):
    noisy = params.model_copy(
        update={"uncertainty": params.uncertainty.model_copy(update={"position_noise": 3.0})}
    )
    at_once = many(plane, 0.0, 0.0) + many(plane, 4.0, 0.0, box=1)
    in_turn = many(plane, 0.0, 0.0) + many(plane, 4.0, 0.0, start_s=60.0)
    assert [place.may_be for place in places(plane, at_once, noisy)] == [(), ()]
    assert [place.may_be for place in places(plane, in_turn, noisy)] == [(2,), (1,)]
    assert seen_at_once(many(plane, 0.0, 0.0), many(plane, 4.0, 0.0, box=1))
    assert not seen_at_once(many(plane, 0.0, 0.0), many(plane, 4.0, 0.0, start_s=60.0))


def test_of_places_that_may_be_one_person_the_surest_counts_once(plane, params):
    looks = many(plane, 0.0, 0.0, "a") + many(plane, 3.0, 0.0, "b", 9.0) + many(plane, -30.0, 0.0, "a", 20.0)
    found = places(plane, looks, params)
    assert len(found) == 3
    assert expected_people(found) == pytest.approx(
        max(found[0].probability, found[1].probability) + found[2].probability
    )
    assert expected_people(()) == 0.0


def listed(terrain, looks, params):
    return found_and_possible({"person": raised(terrain, looks)}, looks, params)


def lowered(terrain, looks, params):
    voxel_map = raised(terrain, looks)
    rows, columns = (np.array([getattr(k, n) for k in looks], dtype=np.int64) for n in ("row", "column"))
    voxel_map.update(rows, columns, np.full(len(rows), -0.5))
    return found_and_possible({"person": voxel_map}, looks, params)


def test_a_place_below_the_threshold_that_was_detected_again_and_again_is_possible(plane, params):
    """Half a metre of wandering: every sighting raises another cell, none reaches the threshold."""
    looks = [
        sighting(plane, 0.25 + 0.5 * dx, 0.25 + 0.5 * dy, k * 0.1, p=0.65)
        for k, (dx, dy) in enumerate(itertools.product((-1, 0, 1), (-1, 0, 1)))
    ]
    found, (possible,) = listed(plane, looks, params)
    assert found == ()
    assert (possible.id, len(possible.sightings), possible.looks) == (1, 9, 1)
    assert possible.probability == pytest.approx(0.65)
    np.testing.assert_allclose(possible.position_enu[:2], [0.25, 0.25], atol=1e-6)


def test_what_was_seen_in_too_few_frames_is_not_possible(plane, params):
    two = [sighting(plane, 0.0, 0.0, 0.1 * k, p=0.55, detector=d) for k in range(2) for d in ("m:n", "m:s")]
    assert listed(plane, two, params) == ((), ())
    assert len(listed(plane, two, params.model_copy(update={"possible_frames": 2}))[1]) == 1


def test_what_the_map_has_given_up_is_possible_all_the_same(plane, params):
    """Nobody detected for long: the map says 'probably empty', five frames said otherwise."""
    _, (possible,) = lowered(plane, many(plane, 0.0, 0.0), params)
    assert possible.probability < 0.7


def test_possible_places_come_after_the_found_ones_the_likeliest_first_and_not_beside_them(plane, params):
    sure = many(plane, 0.0, 0.0, count=9)
    stray = many(plane, 1.6, 0.0, "b", 30.0, count=3)  # may be the person of the found place
    faint = [sighting(plane, 20.0, 0.0, k, p=0.52) for k in range(3)]
    fair = [sighting(plane, 20.0, 20.0, k, p=0.55) for k in range(3)]
    near = [sighting(plane, k.intersection_enu[0], 0.0, k.time_ns * 1e-9, "b", 0.52) for k in stray]
    found, possible = listed(plane, [*sure, *near, *faint, *fair], params)
    assert [place.id for place in (*found, *possible)] == [1, 2, 3]
    assert [place.position_enu[1] > 10.0 for place in possible] == [True, False]


def test_a_stone_that_is_taken_for_a_person_thousands_of_times_costs_no_square_of_that(plane, params):
    """Pairs of sightings would be 8 million; pairs of their cells are a few hundred."""
    rng = np.random.default_rng(4)
    looks = [sighting(plane, *(0.25 + 0.4 * rng.normal(size=2)), 0.1 * k, p=0.502) for k in range(4_000)]
    voxel_map = VoxelMap(plane, 0.1192, 0.971)
    tracemalloc.start()
    _, possible = found_and_possible({"person": voxel_map}, looks, params)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(possible) == 1
    assert len(possible[0].sightings) == 4_000
    assert peak < 50e6

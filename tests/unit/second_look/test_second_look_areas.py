import numpy as np
import pytest

from pipeline.second_look.areas import (
    COARSE,
    FEW_LOOKS,
    HIDDEN,
    LOW_POD,
    NOT_REACHED,
    UNRESOLVED,
    Layers,
    second_look_areas,
)

CELL_M, SHAPE = 0.5, (60, 80)
EVERYWHERE = np.ones(SHAPE, dtype=bool)


def well_seen():
    """Layers of ground that was seen well, twice, and nobody there."""
    return Layers(
        np.full(SHAPE, 0.12, dtype=np.float32),
        np.full(SHAPE, 80, dtype=np.int32),
        np.full(SHAPE, 2, dtype=np.int32),
        np.full(SHAPE, 80.0, dtype=np.float32),
        np.full(SHAPE, 0.9, dtype=np.float32),
    )


def areas(layers, params, searched=EVERYWHERE, **changes):
    look = params.second_look.model_copy(update=changes)
    return second_look_areas(
        layers, searched, (-20.0, -15.0), CELL_M, params.model_copy(update={"second_look": look})
    )


def block(layer, value, rows=slice(10, 20), columns=slice(30, 50)):
    layer[rows, columns] = value


def test_a_mission_that_saw_everything_well_lists_nothing(params):
    assert areas(well_seen(), params) == ()


@pytest.mark.parametrize(
    ("layer", "value", "reason", "changes"),
    [
        ("pod", 0.2, LOW_POD, {}),
        ("resolution_px", 10.0, COARSE, {}),
        ("looks", 1, FEW_LOOKS, {"looks_min": 2}),
        ("observations", 0, HIDDEN, {}),
    ],
)
def test_ground_seen_badly_is_listed_with_its_reason_and_size(params, layer, value, reason, changes):
    layers = well_seen()
    block(getattr(layers, layer), value)
    (area,) = areas(layers, params, **changes)
    assert area.reasons == {reason: 50.0}  # 10 x 20 cells of 0.25 m2
    assert area.area_m2 == 50.0
    (outer,) = area.rings
    assert (outer.min(axis=0).tolist(), outer.max(axis=0).tolist()) == ([-5.0, -10.0], [5.0, -5.0])
    x, y = outer[:, 0], outer[:, 1]
    assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) / 2.0 == pytest.approx(50.0)  # counter-clockwise


def test_ground_at_the_edge_that_was_never_seen_was_not_reached(params):
    layers = well_seen()
    layers.observations[:, 70:] = 0
    (area,) = areas(layers, params)
    assert list(area.reasons) == [NOT_REACHED]


def test_what_was_not_to_be_searched_is_not_listed(params):
    layers, searched = well_seen(), EVERYWHERE.copy()
    layers.observations[:, 70:] = 0
    searched[:, 70:] = False
    assert areas(layers, params, searched) == ()


def test_small_areas_are_left_out_and_near_ones_are_one(params):
    layers = well_seen()
    block(layers.pod, 0.2, slice(10, 14), slice(10, 14))  # 4 m2
    assert areas(layers, params) == ()
    block(layers.pod, 0.2, slice(10, 14), slice(16, 20))  # 4 m2 more, 1 m away
    (area,) = areas(layers, params)
    assert area.area_m2 == 8.0
    assert len(area.rings) == 1


def test_an_undecided_place_comes_before_a_large_area_that_was_seen_badly(params):
    layers = well_seen()
    block(layers.pod, 0.2)
    layers.probability[45, 10] = 0.6
    first, second = areas(layers, params)
    assert (list(first.reasons), list(second.reasons)) == ([UNRESOLVED], [LOW_POD])
    assert first.worth > 0.6 > second.worth


def test_the_edge_of_a_found_place_is_not_undecided(params):
    layers = well_seen()
    layers.probability[45, 10], layers.probability[45, 11] = 0.95, 0.6
    assert areas(layers, params) == ()


def test_a_cell_that_was_hardly_observed_is_not_undecided(params):
    layers = well_seen()
    layers.probability[45, 10], layers.observations[45, 10] = 0.5, 1
    assert areas(layers, params) == ()


def drawn(pieces):
    """Area of rings with holes, by the shoelace formula."""
    x = [np.sum(r[:-1, 0] * r[1:, 1] - r[1:, 0] * r[:-1, 1]) / 2.0 for rings in pieces for r in rings]
    return sum(x)  # holes go round the other way


@pytest.mark.parametrize("seed", range(12))
def test_outlines_are_valid_polygons_that_hold_all_of_the_area(params, seed):
    """No corner twice in a ring or in two rings: then no ring crosses or touches itself or another one."""
    rng = np.random.default_rng(seed)
    layers = well_seen()
    layers.pod[rng.random(SHAPE) < (0.15, 0.3, 0.5)[seed % 3]] = 0.1
    found = areas(layers, params, merge_distance=(0.5, 1.0, 2.0)[seed % 3], min_area=0.25)
    assert found
    for area in found:
        corners = [tuple(p) for rings in area.pieces for ring in rings for p in ring[:-1].round(6).tolist()]
        assert len(corners) == len(set(corners))
        assert all((ring[0] == ring[-1]).all() for rings in area.pieces for ring in rings)
        assert drawn(area.pieces) >= area.area_m2 - 1e-6
        sizes = [abs(drawn([piece])) for piece in area.pieces]
        assert sizes[0] == max(sizes)


def test_two_corners_that_meet_do_not_make_a_ring_that_touches_itself(params):
    layers = well_seen()
    block(layers.pod, 0.2, slice(10, 16), slice(10, 16))
    block(layers.pod, 0.2, slice(16, 22), slice(16, 22))
    (area,) = areas(layers, params, merge_distance=0.5)
    (ring,) = area.rings
    corners = [tuple(p) for p in ring[:-1].tolist()]
    assert len(corners) == len(set(corners))
    assert area.further == ()


def test_pieces_that_are_one_area_but_do_not_touch_are_all_drawn(params):
    layers = well_seen()
    block(layers.pod, 0.2, slice(10, 18), slice(10, 18))
    block(layers.pod, 0.2, slice(10, 18), slice(21, 25))  # 1.5 m away
    (area,) = areas(layers, params)
    assert drawn(area.pieces) >= area.area_m2 == 24.0

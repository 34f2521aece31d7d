"""Streams that place the same people apart by more than they state."""

import numpy as np
import pytest
from test_fusion_one_person import many, places

from pipeline.fusion.disagreement import disagreements

PEOPLE = ((0.0, 0.0), (-20.0, 10.0), (15.0, -18.0), (5.0, 22.0))


def seen(plane, params, offset, *, people=PEOPLE, sd_m=0.3):
    """Two streams in turn, the second off by the offset; and the errors that are stated."""
    stated = params.uncertainty.model_copy(
        update={"position_bias": sd_m, "height_bias": sd_m, "attitude_bias": 0.0, "position_noise": 0.05}
    )
    params = params.model_copy(update={"uncertainty": stated})
    looks = [k for e, n in people for k in many(plane, e, n, "a")]
    looks += [k for e, n in people for k in many(plane, e + offset[0], n + offset[1], "b", 60.0)]
    return disagreements(places(plane, looks, params), stated)


@pytest.mark.parametrize("offset", [(4.0, 0.0), (-5.0, 3.0), (0.0, 8.0)])
def test_streams_that_are_off_by_more_than_stated_are_named(plane, params, offset):
    """So far apart, the places are two each."""
    (found,) = seen(plane, params, offset)
    assert found.streams == ("a", "b")
    np.testing.assert_allclose(found.apart_m, offset, atol=0.1)
    assert found.pairs == len(PEOPLE)
    assert found.stated_m < 1.3


def test_so_are_those_whose_sights_are_in_one_place(plane, params):
    (found,) = seen(plane, params, (1.5, 0.0), sd_m=0.02)
    np.testing.assert_allclose(found.apart_m, (1.5, 0.0), atol=0.1)


@pytest.mark.parametrize(("offset", "sd_m"), [((0.0, 0.0), 0.3), ((0.5, 0.2), 0.3), ((4.0, 0.0), 2.0)])
def test_those_within_what_is_stated_are_not(plane, params, offset, sd_m):
    assert seen(plane, params, offset, sd_m=sd_m) == ()


def test_one_person_may_be_two(plane, params):
    assert seen(plane, params, (4.0, 0.0), people=PEOPLE[:1]) == ()


def test_other_people_are_no_disagreement(plane, params):
    """Each stream saw people that the other did not."""
    looks = [k for e, n in PEOPLE[:3] for k in many(plane, e, n, "a")]
    looks += [k for e, n in ((6.0, 2.0), (-18.0, 0.0), (10.0, -8.0)) for k in many(plane, e, n, "b", 60.0)]
    exact = params.uncertainty.model_copy(update={"position_bias": 0.3, "attitude_bias": 0.0})
    assert disagreements(places(plane, looks, params), exact) == ()


def test_who_saw_people_alone_is_compared_with_nobody(plane, params):
    looks = [k for e, n in PEOPLE for k in many(plane, e, n, "a")]
    assert disagreements(places(plane, looks, params), params.uncertainty) == ()
    assert disagreements((), params.uncertainty) == ()

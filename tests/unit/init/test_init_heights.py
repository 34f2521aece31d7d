"""Of a drone's two heights the one is used that agrees with the ground, and the reason is told."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.ingest.track import Track
from pipeline.init.heights import choose_height

ONE = np.ones(3)
NAN = np.full(3, np.nan)


def track(absolute: float, relative: float) -> Track:
    return Track(0, np.arange(3.0), ONE, ONE, ONE * absolute, ONE * relative, ONE, ONE, ONE)


@pytest.mark.parametrize(
    ("absolute", "terrain_datum", "height", "datum"),
    [
        (130.0, "ellipsoid", "absolute", "ellipsoid"),
        (132.0, "ellipsoid", "absolute", "ellipsoid"),
        (100.0, "ellipsoid", "absolute", "geoid"),
        (160.0, "geoid", "absolute", "ellipsoid"),
        (130.0, "geoid", "absolute", "geoid"),
        (115.0, "ellipsoid", "relative", None),
        (300.0, "ellipsoid", "relative", None),
    ],
)
def test_the_take_off_tells_the_datum_or_that_none_fits(
    absolute: float, terrain_datum: str, height: str, datum: str | None
) -> None:
    choice = choose_height(track(absolute, 30.0), 100.0, terrain_datum, 30.0)  # type: ignore[arg-type]
    assert (choice.height, choice.height_datum) == (height, datum)
    assert choice.reason


def test_a_datum_that_the_format_states_is_not_replaced() -> None:
    stated = replace(track(130.0, 30.0), height_datum="geoid")
    assert choose_height(stated, 100.0, "ellipsoid", 30.0).height == "relative"
    assert choose_height(stated, 130.0, "ellipsoid", 30.0).height_datum == "geoid"


def test_the_only_height_is_used() -> None:
    assert choose_height(track(130.0, np.nan), 100.0, "ellipsoid", 30.0).height == "absolute"
    assert choose_height(track(np.nan, 30.0), 100.0, "ellipsoid", 30.0).height == "relative"
    assert choose_height(track(130.0, 30.0), None, "ellipsoid", 30.0).height == "absolute"


@pytest.mark.parametrize(
    ("either", "ground_m", "height", "why"),
    [
        (40.0, 100.0, "relative", "60 m under the ground"),
        (640.0, 600.0, "absolute", "would reach 640 m"),
        (128.0, 93.0, "absolute", "relative, if they are above take-off"),
        (128.0, None, "absolute", "relative, if they are above take-off"),
    ],
)
def test_a_height_of_no_kind_is_the_one_that_it_can_be(
    either: float, ground_m: float | None, height: str, why: str
) -> None:
    choice = choose_height(track(either, either), ground_m, "geoid", 30.0)
    assert choice.height == height
    assert why in choice.reason

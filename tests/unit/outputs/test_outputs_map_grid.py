"""The grid of the map: what its labels say is where they stand."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure
from pyproj import Proj

from pipeline.geo.frame import LocalFrame
from pipeline.outputs.map_grid import draw_grid


def axes_over(west: float, south: float, east: float, north: float):  # type: ignore[no-untyped-def]
    axes = Figure().add_subplot()
    axes.set_xlim(west, east)
    axes.set_ylim(south, north)
    return axes


@pytest.mark.parametrize(
    ("latitude", "longitude", "zone", "extent"),
    [
        (58.4, 15.5756, 33, (-45.0, -50.0, 60.0, 75.0)),
        (63.4, 10.4, 32, (-2000.0, -300.0, 2500.0, 9000.0)),
        (-33.86, 151.2, 56, (0.0, 0.0, 7.0, 5.0)),
        (60.5, 5.9, 32, (-1000.0, -1000.0, 1000.0, 1000.0)),
    ],
)
def test_a_label_stands_where_its_coordinate_is(
    latitude: float, longitude: float, zone: int, extent: tuple[float, float, float, float]
) -> None:
    frame = LocalFrame(latitude, longitude)
    axes = axes_over(*extent)
    draw_grid(axes, frame)
    west, south, east, north = extent
    assert (axes.get_xlim(), axes.get_ylim()) == ((west, east), (south, north))
    utm = Proj(proj="utm", zone=zone, ellps="WGS84", south=latitude < 0)
    labels = [
        (tick, text.get_text(), axis)
        for axis, ticks, texts in (
            (0, axes.get_xticks(), axes.get_xticklabels()),
            (1, axes.get_yticks(), axes.get_yticklabels()),
        )
        for tick, text in zip(ticks, texts, strict=True)
    ]
    assert {axis for _, _, axis in labels} == {0, 1}
    for tick, text, axis in labels:
        at = frame.wgs84_from_enu(
            np.array(tick if axis == 0 else west), np.array(south if axis == 0 else tick)
        )
        assert utm(float(at[1]), float(at[0]))[axis] == pytest.approx(float(text), abs=0.02)
    assert f"UTM zone {zone}" in axes.get_xlabel()


def test_the_square_is_named_only_if_it_is_the_only_one() -> None:
    frame = LocalFrame(58.4, 15.5756)
    near, far = axes_over(-50, -50, 50, 50), axes_over(-60_000, -60_000, 60_000, 60_000)
    draw_grid(near, frame)
    draw_grid(far, frame)
    assert "MGRS 33V WE" in near.get_xlabel()
    assert "MGRS" not in far.get_xlabel()


def test_near_a_pole_metres_are_from_a_named_origin() -> None:
    axes = axes_over(-50, -50, 50, 50)
    draw_grid(axes, LocalFrame(86.0, 15.0))
    assert axes.get_xlabel() == "east of 86.000000, 15.000000 (WGS84), m"

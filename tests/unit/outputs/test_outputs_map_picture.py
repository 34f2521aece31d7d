import io
from collections.abc import Callable

import numpy as np
import pytest
from matplotlib.image import imread
from synthetic_search import Size, map_of

from pipeline.fusion.voxel_map import VoxelMap
from pipeline.outputs.map_picture import _block_max, _round_length_m, map_picture, observed_area_m2, png
from pipeline.outputs.report import ReportData

Search = Callable[..., ReportData]


def forget(voxel_map: VoxelMap, columns: slice) -> None:
    cells = np.indices(voxel_map.terrain.shape)[:, :, columns].reshape(2, -1)
    voxel_map.tiles.cells["observations"][voxel_map.tiles.flat(*cells)] = 0


def test_the_picture_is_a_png_and_the_same_every_time(search: Search) -> None:
    data = search()
    pictures = [
        png(map_picture(data.voxel_map, data.tracks, data.summary.locations, data.truth)) for _ in range(2)
    ]
    assert pictures[0] == pictures[1]
    image = imread(io.BytesIO(pictures[0]))
    assert min(image.shape[:2]) > 400


def test_the_picture_shows_only_what_was_looked_at_or_flown_over(search: Search) -> None:
    data = search(size=Size(rows=60, columns=200))
    forget(data.voxel_map, slice(60, None))
    axes = map_picture(data.voxel_map, {}, ()).axes[0]
    west = data.voxel_map.terrain.east_m
    assert axes.get_xlim() == pytest.approx((west, west + 60 * 0.5 + 8.0))


def test_places_tracks_and_truth_are_in_the_legend(search: Search) -> None:
    data = search()
    figure = map_picture(data.voxel_map, data.tracks, data.summary.locations, data.truth)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == [
        "track of drone-1 (dot: start)",
        "track of drone-2 (dot: start)",
        "true place",
        "found place, with its number",
        "its error ellipse, 95 %",
    ]
    numbers = {text.get_text() for text in figure.axes[0].texts}
    assert {"1", "2", "3", "N"} <= numbers


def test_an_empty_map_has_a_picture() -> None:
    voxel_map = map_of(Size(8, 8), np.zeros((0, 2)))
    forget(voxel_map, slice(None))
    assert png(map_picture(voxel_map, {}, ())).startswith(b"\x89PNG")


def test_a_single_cell_survives_in_a_large_map() -> None:
    values = np.full((3001, 2999), np.nan)
    values[1234, 2345] = 0.9
    smaller = _block_max(values)
    assert max(smaller.shape) <= 1400
    assert np.nanmax(smaller) == 0.9
    assert np.isfinite(smaller).sum() == 1


@pytest.mark.parametrize(
    ("most_m", "length_m"), [(1.0, 1.0), (3.0, 2.0), (7.9, 5.0), (44.0, 20.0), (999.0, 500.0)]
)
def test_the_scale_bar_is_of_a_round_length(most_m: float, length_m: float) -> None:
    assert _round_length_m(most_m) == length_m


def test_the_observed_area_is_that_of_the_observed_cells() -> None:
    voxel_map = map_of(Size(10, 10, 2.0), np.zeros((0, 2)))
    assert observed_area_m2(voxel_map) == 9 * 8 * 4.0

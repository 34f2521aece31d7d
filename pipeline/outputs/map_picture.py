"""The map as a picture: shaded relief, probability, flight tracks, found and true places."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LightSource, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.fusion.salient import SalientLocation
from pipeline.fusion.voxel_map import VoxelMap
from pipeline.messages import FloatArray
from pipeline.outputs.map_grid import draw_grid
from pipeline.outputs.truth import TruePerson
from pipeline.second_look.areas import SecondLookArea
from pipeline.second_look.flight import SecondFlight

#: after Okabe and Ito: apart from each other and from the probability's colours, also for the colour-blind
TRACK_COLORS = ("#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#332288", "#882255")
_LINE_STYLES = ("-", "--", "-.", ":")
_ELLIPSE: dict[str, Any] = {"color": "#B3123B", "lw": 1.3}
_MARGIN_M = 8.0
_MOST_PIXELS = 1400
_DPI = 150
_HALO = [patheffects.withStroke(linewidth=2.5, foreground="white")]


def map_picture(
    voxel_map: VoxelMap,
    tracks: Mapping[str, FloatArray],
    locations: Sequence[SalientLocation],
    truth: Sequence[TruePerson] = (),
    possible: Sequence[SalientLocation] = (),
) -> Figure:
    """Draw the part of the map that was observed or flown over.

    tracks: positions of each drone, stream -> float64 (N, >=2), ENU metres. truth: empty if not known. possible:
    places below the threshold.
    """
    window = _window(voxel_map, tracks, truth)
    figure = Figure(figsize=_size_in(voxel_map, window), dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    _draw_ground(axes, voxel_map, window)
    _draw_probability(figure, axes, voxel_map, window)
    handles = _draw_tracks(axes, tracks)
    handles += _draw_truth(axes, truth)
    handles += _draw_places(axes, locations)
    handles += _draw_possible(axes, possible)
    _draw_scale_and_north(axes)
    draw_grid(axes, voxel_map.terrain.frame)
    if handles:
        columns = 2
        figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize=10)
    return figure


def draw_map(
    axes: Axes,
    voxel_map: VoxelMap,
    locations: Sequence[SalientLocation],
    truth: Sequence[TruePerson] = (),
) -> ScalarMappable:
    """The same as a small picture among others: relief, probability, people and places; for a colour bar."""
    window = _window(voxel_map, {}, truth)
    _draw_ground(axes, voxel_map, window)
    shown = _draw_colors(axes, voxel_map, window)
    _draw_truth(axes, truth)
    for place in locations:
        axes.plot(*(place.position_enu[:2] + place.error.outline()).T, zorder=6, **_ELLIPSE)
    axes.tick_params(labelsize=8)
    return shown


def second_look_picture(voxel_map: VoxelMap, areas: Sequence[SecondLookArea], flight: SecondFlight) -> Figure:
    """The areas worth a second look, by number, and the flight over them."""
    rings = {f"area {area.id}": area.rings[0] for area in areas}
    window = _window(voxel_map, rings | {"home": flight.home_enu[None]}, ())
    figure = Figure(figsize=_size_in(voxel_map, window), dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    _draw_ground(axes, voxel_map, window)
    _draw_colors(axes, voxel_map, window)
    for area in areas:
        for outer, *holes in area.pieces:
            axes.fill(*outer.T, fc="#E69F0066", ec="#A05A00", lw=1.4, zorder=3)
            for hole in holes:
                axes.fill(*hole.T, fc="#ffffff66", ec="#A05A00", lw=0.8, zorder=3)
        style: dict[str, Any] = {
            "ha": "center",
            "va": "center",
            "fontsize": 11,
            "fontweight": "bold",
            "zorder": 6,
        }
        axes.annotate(str(area.id), area.cells_enu.mean(axis=0), path_effects=_HALO, **style)
    way = np.array([flight.home_enu, *(w.position_enu for w in flight.waypoints)])
    axes.plot(way[:, 0], way[:, 1], color="#0072B2", lw=1.5, zorder=4, path_effects=_HALO)
    hover = np.array([w.position_enu for w in flight.waypoints if w.hover_s > 0.0]).reshape(-1, 3)
    axes.plot(hover[:, 0], hover[:, 1], "o", color="#0072B2", mec="white", ms=6, zorder=5)
    axes.plot(*flight.home_enu[:2], marker="s", color="black", mec="white", ms=8, zorder=5)
    _draw_scale_and_north(axes)
    draw_grid(axes, voxel_map.terrain.frame)
    handles = [
        Line2D([], [], ls="", marker="s", color="#E69F00", mec="#A05A00", label="worth a second look"),
        Line2D([], [], color="#0072B2", label="proposed flight (dot: hover, square: home)"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False, fontsize=10)
    return figure


def png(figure: Figure) -> bytes:
    """The figure as PNG; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    FigureCanvasAgg(figure)
    figure.savefig(buffer, format="png", bbox_inches="tight", metadata={"Software": None})
    return buffer.getvalue()


Window = tuple[slice, slice]


def _window(voxel_map: VoxelMap, tracks: Mapping[str, FloatArray], truth: Sequence[TruePerson]) -> Window:
    terrain = voxel_map.terrain
    known = voxel_map.touched_window()
    observed = np.argwhere(voxel_map.layer("observations", known)) + np.array(
        [known[0].start, known[1].start]
    )
    points = [terrain.cells(track) for track in tracks.values()]
    points += [terrain.cells(person.track_enu) for person in truth]
    cells = np.concatenate([observed, *points])
    cells = cells[cells[:, 0] >= 0]
    if not len(cells):
        return slice(0, terrain.shape[0]), slice(0, terrain.shape[1])
    margin = math.ceil(_MARGIN_M / terrain.cell_m)
    low, high = np.maximum(cells.min(axis=0) - margin, 0), cells.max(axis=0) + 1 + margin
    return slice(int(low[0]), min(int(high[0]), terrain.shape[0])), slice(
        int(low[1]), min(int(high[1]), terrain.shape[1])
    )


def _size_in(voxel_map: VoxelMap, window: Window) -> tuple[float, float]:
    rows, columns = (part.stop - part.start for part in window)
    aspect = rows / columns
    width = 8.0 if aspect < 1.1 else max(5.5, 8.0 * 1.1 / aspect)
    return width, min(max(width * 0.88 * aspect, 2.5), 12.0) + 1.1


def _extent(voxel_map: VoxelMap, window: Window) -> tuple[float, float, float, float]:
    terrain, (rows, columns) = voxel_map.terrain, window
    return (
        terrain.east_m + columns.start * terrain.cell_m,
        terrain.east_m + columns.stop * terrain.cell_m,
        terrain.north_m + rows.start * terrain.cell_m,
        terrain.north_m + rows.stop * terrain.cell_m,
    )


def _draw_ground(axes: Axes, voxel_map: VoxelMap, window: Window) -> None:
    heights = voxel_map.terrain.heights_m[window]
    step = max(1, math.ceil(max(heights.shape) / _MOST_PIXELS))
    heights = heights[::step, ::step].astype(np.float64)
    known = np.isfinite(heights)
    filled = np.where(known, heights, np.nanmean(heights) if known.any() else 0.0)
    cell_m = voxel_map.terrain.cell_m * step
    # the light comes from the north-west, as on every map; rows run south to north, hence the sign of dy
    shade = LightSource(azdeg=315, altdeg=45).hillshade(filled, vert_exag=1.5, dx=cell_m, dy=-cell_m)
    gray = 0.45 + 0.5 * np.clip(shade, 0.0, 1.0)
    rgba = np.stack([gray, gray, gray, known.astype(np.float64)], axis=2)
    extent = _extent(voxel_map, window)
    axes.imshow(rgba, origin="lower", extent=extent, interpolation="bilinear", zorder=0)
    axes.set_facecolor("#f4f4f4")


def _draw_probability(figure: Figure, axes: Axes, voxel_map: VoxelMap, window: Window) -> None:
    shown = _draw_colors(axes, voxel_map, window)
    bar = figure.colorbar(shown, ax=axes, shrink=0.6, aspect=28, pad=0.01)
    bar.set_label("probability of a person (no colour: not looked at)", fontsize=9)


def _draw_colors(axes: Axes, voxel_map: VoxelMap, window: Window) -> ScalarMappable:
    observed = voxel_map.layer("observations", window) > 0
    shown = _block_max(np.where(observed, voxel_map.probability(window), np.nan))
    colors, scale = _colors(), Normalize(0.0, 1.0)
    axes.imshow(
        colors(scale(np.ma.masked_invalid(shown))),
        origin="lower",
        extent=_extent(voxel_map, window),
        interpolation="nearest",
        zorder=1,
    )
    return ScalarMappable(scale, colors)


def _block_max(values: FloatArray) -> FloatArray:
    """Fewer pixels for a large map; a block shows its greatest value, so that nobody vanishes."""
    step = math.ceil(max(values.shape) / _MOST_PIXELS)
    rows, columns = (math.ceil(size / step) for size in values.shape)
    padded = np.full((rows * step, columns * step), np.nan)
    padded[: values.shape[0], : values.shape[1]] = values
    blocks = padded.reshape(rows, step, columns, step)
    return np.fmax.reduce(np.fmax.reduce(blocks, axis=3), axis=1)


def _colors() -> ListedColormap:
    """Viridis, opaque where a person is likely: what was searched in vain lets the relief through."""
    colors = matplotlib.colormaps["viridis"](np.linspace(0.0, 1.0, 256))
    colors[:, 3] = np.interp(np.linspace(0.0, 1.0, 256), [0.0, 0.3, 0.7, 1.0], [0.38, 0.45, 0.95, 1.0])
    return ListedColormap(colors)


def _draw_tracks(axes: Axes, tracks: Mapping[str, FloatArray]) -> list[Line2D]:
    handles = []
    for k, (stream, track) in enumerate(sorted(tracks.items())):
        color, style = TRACK_COLORS[k % len(TRACK_COLORS)], _LINE_STYLES[k % len(_LINE_STYLES)]
        axes.plot(track[:, 0], track[:, 1], color="white", lw=3.0, alpha=0.6, zorder=2)
        axes.plot(track[:, 0], track[:, 1], color=color, lw=1.5, ls=style, zorder=3)
        axes.plot(*track[0, :2], marker="o", ms=5, mfc=color, mec="white", zorder=3)
        label = f"track of {stream} (dot: start)"
        handles.append(Line2D([], [], color=color, ls=style, lw=1.8, label=label))
    return handles


def _draw_truth(axes: Axes, truth: Sequence[TruePerson]) -> list[Line2D]:
    style: dict[str, Any] = {"color": "#D55E00", "marker": "x", "ms": 7, "mew": 2.2, "path_effects": _HALO}
    for person in truth:
        east, north = person.track_enu[:, 0], person.track_enu[:, 1]
        axes.plot(east, north, color="#D55E00", lw=1.5, zorder=4)
        axes.plot(east[-1], north[-1], ls="", zorder=5, **style)
    return [Line2D([], [], ls="", label="true place", **style)] if truth else []


def _draw_places(axes: Axes, locations: Sequence[SalientLocation]) -> list[Line2D]:
    style: dict[str, Any] = {
        "marker": "o",
        "ms": 15,
        "mfc": "none",
        "mec": "#111111",
        "mew": 1.8,
        "path_effects": _HALO,
    }
    for place in locations:
        east, north = place.position_enu[:2]
        axes.plot(east, north, zorder=6, **style)
        outline = place.position_enu[:2] + place.error.outline()
        axes.plot(*outline.T, zorder=6, **_ELLIPSE)
        halo = [patheffects.withStroke(linewidth=3.5, foreground="white")]
        _number(axes, place, 8, fontsize=12, fontweight="bold", path_effects=halo)
    small = style | {"ms": 10}
    found = Line2D([], [], ls="", label="found place, with its number", **small)
    ellipse = Line2D([], [], label="its error ellipse, 95 %", **_ELLIPSE)
    return [found, ellipse] if locations else []


def _draw_possible(axes: Axes, possible: Sequence[SalientLocation]) -> list[Line2D]:
    style: dict[str, Any] = {"marker": "D", "ms": 9, "mfc": "none", "mec": "#111111", "mew": 1.2}
    for place in possible:
        east, north = place.position_enu[:2]
        axes.plot(east, north, zorder=6, ls="", path_effects=_HALO, **style)
        _number(axes, place, 6, fontsize=9, path_effects=_HALO)
    return [Line2D([], [], ls="", label="possible place", **style)] if possible else []


def _number(axes: Axes, place: SalientLocation, points: int, **style: Any) -> None:
    """A place's id, so many points right of it and above."""
    east, north = place.position_enu[:2]
    axes.annotate(
        str(place.id),
        (east, north),
        xytext=(points, points),
        textcoords="offset points",
        zorder=7,
        **style,
    )


def _draw_scale_and_north(axes: Axes) -> None:
    west, east = axes.get_xlim()
    south, north = axes.get_ylim()
    length_m = _round_length_m(0.22 * (east - west))
    x, y = west + 0.03 * (east - west), south + 0.03 * (north - south)
    halo = [patheffects.withStroke(linewidth=6, foreground="white")]
    axes.plot(
        [x, x + length_m], [y, y], color="black", lw=3, solid_capstyle="butt", path_effects=halo, zorder=8
    )
    axes.annotate(
        f"{length_m:g} m",
        (x + length_m / 2, y),
        xytext=(0, 5),
        textcoords="offset points",
        ha="center",
        fontsize=10,
        path_effects=_HALO,
        zorder=8,
    )
    axes.annotate(
        "N",
        (0.97, 0.985),
        (0.97, 0.885),
        xycoords="axes fraction",
        ha="center",
        va="center",
        fontsize=13,
        fontweight="bold",
        path_effects=_HALO,
        arrowprops={"arrowstyle": "-|>", "color": "black", "lw": 2},
        zorder=8,
    )


def _round_length_m(most_m: float) -> float:
    """The greatest 1, 2 or 5 times a power of ten that is at most most_m."""
    power = 10.0 ** math.floor(math.log10(most_m))
    return max(digit * power for digit in (1.0, 2.0, 5.0) if digit * power <= most_m)


def observed_area_m2(voxel_map: VoxelMap) -> float:
    """Ground area of the cells that were looked at, square metres."""
    tiles = voxel_map.tiles
    seen = sum(np.count_nonzero(tiles.tile(*tile)["observations"]) for tile in tiles.touched_tiles())
    return float(seen) * voxel_map.terrain.cell_m**2

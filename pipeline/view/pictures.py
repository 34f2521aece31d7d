"""What is drawn of a map as pictures: the layers in colours that colour-blind people can tell apart, the ground."""

from __future__ import annotations

import io

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.view.decisions import WEIGHT
from pipeline.view.ground import Ground
from pipeline.view.layer import STEPS, Layer
from pipeline.view.places import Place

#: both are read alike by people who confuse red and green, and get lighter evenly
COLOURS = {"probability": "cividis", "pod": "viridis"}
#: nobody looked: grey stripes, which no value of a map looks like
_DARK, _LIGHT, _STRIPE = (46, 46, 52), (92, 92, 100), 8
_ALPHA = 190


def layer_png(layer: Layer, name: str) -> bytes:
    """name: probability or pod. North up."""
    values = layer.probability if name == "probability" else layer.pod
    table = matplotlib.colormaps[COLOURS[name]](np.linspace(0.0, 1.0, STEPS + 1))[:, :3]
    colours = np.zeros((256, 4), dtype=np.uint8)
    colours[1:, :3] = np.round(255.0 * table)
    colours[1:, 3] = _ALPHA
    picture = colours[values]
    rows, columns = np.indices(values.shape)
    stripe = ((rows + columns) // (_STRIPE // 2)) % 2 == 0
    nobody = values == 0
    picture[nobody & stripe] = (*_LIGHT, _ALPHA)
    picture[nobody & ~stripe] = (*_DARK, _ALPHA)
    return _png(picture)


def with_votes(layer: Layer, places: tuple[Place, ...]) -> Layer:
    """The layer after the decisions: each place's net votes shift the log-odds of the cells in its error ellipse.

    Always worked out from the run's own layer, so a decision taken back leaves the bytes as they were.
    """
    probability = layer.probability
    for place in sorted((p for p in places if p.net), key=lambda p: p.id):
        probability = _shifted(probability, layer, place)
    return Layer(layer.east_m, layer.north_m, layer.cell_m, probability, layer.pod)


def _shifted(values: NDArray[np.uint8], layer: Layer, place: Place) -> NDArray[np.uint8]:
    major, minor, orientation_deg = place.semi_axes_m
    rows, columns = np.indices(values.shape)
    east = layer.east_m + (columns + 0.5) * layer.cell_m - place.east_m
    north = layer.north_m + (rows + 0.5) * layer.cell_m - place.north_m
    turn = np.radians(orientation_deg)
    along, across = (
        north * np.cos(turn) + east * np.sin(turn),
        east * np.cos(turn) - north * np.sin(turn),
    )
    reach = layer.cell_m
    inside = (along / max(major, reach)) ** 2 + (across / max(minor, reach)) ** 2 <= 1.0
    mine = inside & (values > 0)
    p = np.clip((values[mine].astype(np.float64) - 1.0) / STEPS, 1e-3, 1.0 - 1e-3)
    shifted = 1.0 / (1.0 + np.exp(-(np.log(p / (1.0 - p)) + place.net * WEIGHT)))
    result = values.copy()
    result[mine] = (1.0 + np.round(STEPS * shifted)).astype(np.uint8)
    return result


def hillshade_png(ground: Ground) -> bytes:
    """The ground lit from the north-west, dark; transparent where its height is not known. North up."""
    heights = ground.heights_m.astype(np.float64)
    if min(heights.shape) < 2:
        return _png(np.zeros((1, 1, 4), dtype=np.uint8))
    north, east = np.gradient(heights, ground.cell_m)
    light = (1.0 + east * 0.5 - north * 0.5) / np.sqrt(1.0 + east**2 + north**2)
    known = np.isfinite(light)
    grey = np.where(known, np.clip(30.0 + 60.0 * np.nan_to_num(light), 10.0, 150.0), 0.0).astype(np.uint8)
    return _png(np.stack([grey, grey, grey, np.where(known, 255, 0).astype(np.uint8)], axis=2))


def _png(picture: NDArray[np.uint8]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(picture[::-1]), "RGBA").save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()

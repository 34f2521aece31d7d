"""Random crops of the training pictures, as the network could see them in another place, light and camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pipeline.config.base import Strict
from pipeline.config.units import Fraction
from pipeline.detection.resize import resize
from pipeline.messages import FloatArray
from pipeline.training.pictures import PictureSet

#: drawing fresh noise for each crop would take longer than all the rest of it
_NOISE = np.random.default_rng(0).standard_normal(2**21, np.float32)


class AugmentationParams(Strict):
    """What is varied.

    crop: edge of the square that the network learns from, in pixels of its input.
    scale_min, scale_max: size of things relative to what the network sees of a whole picture.
    on_person: share of crops around a person. degraded: share from the pictures after the codec.
    light: largest change of brightness and contrast, as a share. tint: of each colour. noise: largest
    standard deviation, of values 0..255. blur: share of crops that are blurred. inverted: share of crops in
    the other polarity, as thermal cameras show them (black hot).
    visible_min: people less visible than this, and edge_min: boxes with a shorter edge (pixels of the input),
    are neither right nor wrong.
    """

    crop: int = Field(ge=64, le=768, multiple_of=16)
    scale_min: float = Field(gt=0.1)
    scale_max: float = Field(lt=10.0)
    on_person: Fraction
    degraded: Fraction
    light: Fraction
    tint: Fraction
    noise: float = Field(ge=0.0)
    blur: Fraction
    inverted: Fraction = 0.0
    visible_min: Fraction
    edge_min: float = Field(ge=0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Crop:
    """image: uint8 (crop, crop, 3). people, ignored: boxes (N, 4) xyxy in its pixels, as far as inside."""

    image: NDArray[np.uint8]
    people: FloatArray
    ignored: FloatArray


def random_crop(
    pictures: PictureSet, network_width: int, params: AugmentationParams, rng: np.random.Generator
) -> Crop:
    """A random crop of a random picture."""
    index = int(rng.choice(pictures.numbers))
    source = pictures.degraded if rng.random() < params.degraded else pictures.clean
    boxes, visible = pictures.boxes_px[index], pictures.visible_shares[index]
    height, width = source.shape[1:3]
    scale = network_width / width * np.exp(rng.uniform(np.log(params.scale_min), np.log(params.scale_max)))
    size = min(round(params.crop / scale), height, width)
    left, top = _corner(boxes, size, width, height, params, rng)
    cut = source[index, top : top + size, left : left + size]
    image = resize(cut, params.crop, params.crop)
    inside = (boxes - [left, top, left, top]) * (params.crop / size)
    if rng.random() < 0.5:
        image, inside = image[:, ::-1], (inside * [-1, 1, -1, 1] + [params.crop, 0] * 2)[:, [2, 1, 0, 3]]
    people, ignored = _split(inside, visible, params)
    return Crop(_disturbed(image, params, rng), people, ignored)


def _corner(
    boxes: FloatArray,
    size: int,
    width: int,
    height: int,
    params: AugmentationParams,
    rng: np.random.Generator,
) -> tuple[int, int]:
    """Left and top of a crop, around a random person or anywhere."""
    room = np.array([width - size, height - size])
    corner = rng.uniform(0, room + 1)
    if len(boxes) and rng.random() < params.on_person:
        box = boxes[rng.integers(len(boxes))]
        corner = (box[:2] + box[2:]) / 2 - size * rng.uniform(0.1, 0.9, 2)
    left, top = np.clip(corner, 0, room).astype(int)
    return int(left), int(top)


def _split(
    boxes: FloatArray, visible: FloatArray, params: AugmentationParams
) -> tuple[FloatArray, FloatArray]:
    """People to be found, and those that are neither right nor wrong; both cut at the crop's edge."""
    cut = np.clip(boxes, 0.0, params.crop)
    whole, rest = (np.maximum(b[:, 2:] - b[:, :2], 0.0).prod(axis=1) for b in (boxes, cut))
    in_crop = np.divide(rest, whole, out=np.zeros_like(rest), where=whole > 0)
    touched = rest > 0
    clear = (visible * in_crop >= params.visible_min) & (
        (cut[:, 2:] - cut[:, :2]).min(axis=1) >= params.edge_min
    )
    return cut[touched & clear], cut[touched & ~clear]


def _disturbed(
    image: NDArray[np.uint8], params: AugmentationParams, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Another light, tint, sharpness and sensor noise."""
    values = image.astype(np.float32)
    if params.inverted and rng.random() < params.inverted:
        values = 255.0 - values
    if rng.random() < params.blur:
        values = _blurred(values)
    contrast = 1.0 + rng.uniform(-params.light, params.light)
    gain = contrast * (1.0 + rng.uniform(-params.tint, params.tint, 3))
    offset = 128.0 * (1.0 - contrast) + 128.0 * rng.uniform(-params.light, params.light)
    values = values * gain.astype(np.float32) + np.float32(offset)
    start = rng.integers(_NOISE.size - values.size)
    noise = _NOISE[start : start + values.size].reshape(values.shape)
    values += np.float32(rng.uniform(0, params.noise)) * noise
    return np.clip(values, 0, 255).astype(np.uint8)


def _blurred(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """The binomial 1-2-1 filter along both axes; the border wraps round, one pixel wide."""
    for axis in (0, 1):
        neighbours = np.roll(values, 1, axis) + np.roll(values, -1, axis)
        values = values * np.float32(0.5) + neighbours * np.float32(0.25)
    return values

"""A picture as a network takes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from pipeline.config.layout import PictureInput, SizeInput
from pipeline.detection.placement import Placement, letterbox, stretch
from pipeline.errors import InputError

_SIZES = {
    "float16": np.float16,
    "float32": np.float32,
    "float64": np.float64,
    "int32": np.int32,
    "int64": np.int64,
}


@dataclass(frozen=True, slots=True)
class Preparation:
    """size: width and height of the input; None: the picture's. dtype: of the input."""

    input: PictureInput
    sizes: tuple[SizeInput, ...]
    size_dtypes: tuple[str, ...]
    size: tuple[int, int] | None
    dtype: str

    def place(self, image: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], Placement]:
        """The picture (H, W, 3) RGB in the input's size, and where in it it is."""
        if self.size is None:
            return image, Placement(1.0, 1.0)
        width, height = self.size
        if self.input.placement == "stretched":
            return stretch(image, width, height, self.input.filter)
        centred = self.input.placement == "letterbox_centred"
        return letterbox(
            image, width, height, fill=self.input.fill, centred=centred, method=self.input.filter
        )

    def inputs(self, placed: list[NDArray[np.uint8]]) -> dict[str, NDArray[Any]]:
        """The model's inputs for pictures that are placed, all of one size."""
        height, width = placed[0].shape[:2]
        inputs: dict[str, NDArray[Any]] = {self.input.tensor: self._pictures(placed)}
        for size, dtype in zip(self.sizes, self.size_dtypes, strict=True):
            pair = {"width_height": (width, height), "height_width": (height, width), "ones": (1, 1)}
            inputs[size.tensor] = np.array([pair[size.value]] * len(placed), _SIZES[dtype])
        return inputs

    def _pictures(self, placed: list[NDArray[np.uint8]]) -> NDArray[Any]:
        if self.dtype == "uint8":
            ordered = [_ordered(picture, self.input.colour) for picture in placed]
            stacked = ordered[0][None] if len(ordered) == 1 else np.stack(ordered)
            planar = stacked.transpose(0, 3, 1, 2) if "chw" in self.input.axes else stacked
        else:
            planar = self._normalised(placed)
        single = self.input.axes in ("chw", "hwc")
        return np.ascontiguousarray(planar[0] if single else planar)

    def _normalised(self, placed: list[NDArray[np.uint8]]) -> NDArray[Any]:
        layout = self.input
        std = np.array(layout.std, np.float64)
        scale = (layout.range / 255.0 / std).astype(np.float32)
        shift = (np.array(layout.mean) / std).astype(np.float32)
        if layout.colour == "grey":
            grey = np.stack([_ordered(picture, "grey") for picture in placed]).astype(np.float32)
            values = (grey * scale[0] - shift[0]).transpose(0, 3, 1, 2)
        else:
            height, width = placed[0].shape[:2]
            values = np.empty((len(placed), 3, height, width), np.float32)
            first = 2 if layout.colour == "bgr" else 0
            for picture, out in zip(placed, values, strict=True):
                normalise(np.ascontiguousarray(picture), out, first, scale, shift)
        if "hwc" in layout.axes:
            values = values.transpose(0, 2, 3, 1)
        return values if self.dtype == "float32" else values.astype(_SIZES[self.dtype])


def _ordered(picture: NDArray[np.uint8], colour: str) -> NDArray[np.uint8]:
    if colour == "bgr":
        return picture[..., ::-1]
    if colour == "grey":  # ITU-R BT.601
        grey = (picture @ np.array([0.299, 0.587, 0.114], np.float32))[..., None]
        return np.asarray(grey + 0.5, np.uint8)
    return picture


@numba.njit(cache=True, fastmath=True)
def normalise(
    picture: NDArray[np.uint8],
    out: NDArray[np.float32],
    first: int,
    scale: NDArray[np.float32],
    shift: NDArray[np.float32],
) -> None:
    """out (3, H, W) = picture (H, W, 3) * scale - shift, plane 0 from colour ``first`` (0 or 2)."""
    for plane in range(3):
        colour = abs(first - plane)
        k, s = scale[plane], shift[plane]
        for y in range(out.shape[1]):
            row, line = picture[y], out[plane, y]
            for x in range(out.shape[2]):
                line[x] = np.float32(row[x, colour]) * k - s


def require_dtype(where: object, dtype: str) -> None:
    """Raises InputError for an input that pictures cannot be given as."""
    if dtype != "uint8" and dtype not in ("float16", "float32", "float64"):
        raise InputError(where, f"a picture as {dtype}", "an input of uint8, float16 or float32")

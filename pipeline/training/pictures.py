"""The pictures to learn from, on disk: clean ones, the same ones after a lossy codec, and the people in them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.messages import FloatArray

Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class LabelledPicture:
    """image: uint8 (H, W, 3) RGB. boxes_px: (N, 4) xyxy, as far as inside the picture. visible_shares: (N,) 0..1."""

    image: Image
    boxes_px: FloatArray
    visible_shares: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class PictureSet:
    """clean, degraded: uint8 (N, H, W, 3), mapped from disk. boxes_px and visible_shares: one array per picture."""

    clean: Image
    degraded: Image
    boxes_px: list[FloatArray]
    visible_shares: list[FloatArray]

    def __len__(self) -> int:
        return len(self.boxes_px)


def save_pictures(
    folder: Path,
    pictures: Iterable[LabelledPicture],
    count: int,
    degrade: Callable[[Image], Image],
    *,
    size: tuple[int, int] = (1024, 576),
) -> None:
    """Write count pictures of size (width, height). degrade: what the link does to a picture.

    ``people.json`` is written last: a folder that has it is complete.
    """
    folder.mkdir(parents=True, exist_ok=True)
    shape = (count, size[1], size[0], 3)
    clean, degraded = (
        np.lib.format.open_memmap(folder / f"{name}.npy", mode="w+", dtype=np.uint8, shape=shape)
        for name in ("clean", "degraded")
    )
    people = []
    for i, picture in zip(range(count), pictures, strict=False):
        clean[i], degraded[i] = picture.image, degrade(picture.image)
        people.append({"boxes": picture.boxes_px.tolist(), "visible": picture.visible_shares.tolist()})
    clean.flush()
    degraded.flush()
    (folder / "people.json").write_text(json.dumps(people), encoding="utf-8")


def is_complete(folder: Path) -> bool:
    """Whether save_pictures has finished there."""
    return (folder / "people.json").is_file()


def open_pictures(folder: Path) -> PictureSet:
    """What save_pictures wrote. Raises InputError if it did not finish there."""
    if not is_complete(folder):
        raise InputError(folder, "no complete picture set", "a folder written by searchlight train")
    people: list[dict[str, Any]] = json.loads((folder / "people.json").read_text(encoding="utf-8"))
    return PictureSet(
        np.load(folder / "clean.npy", mmap_mode="r"),
        np.load(folder / "degraded.npy", mmap_mode="r"),
        [np.array(entry["boxes"], float).reshape(-1, 4) for entry in people],
        [np.array(entry["visible"], float) for entry in people],
    )

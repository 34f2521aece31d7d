"""Images of a COCO document by what a key of each says: flights, places, days."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.config.evaluation import Sequences
from pipeline.errors import InputError


def of_groups(document: Any, key: str, groups: tuple[int | str, ...], where: Path) -> dict[str, Any]:
    """The same document with the images of some groups and their annotations only.

    where: for messages. Raises InputError if an image has no group, or a wanted group no image.
    """
    images = document.get("images") if isinstance(document, dict) else None
    if not isinstance(images, list):
        raise InputError(where, "no images", "a COCO JSON file")
    there = {_value(image, key, f"{where} images.{number}.{key}") for number, image in enumerate(images)}
    for group in groups:
        if group not in there:
            known = ", ".join(map(str, sorted(there, key=str)))
            raise InputError(where, f"no image of {key} {group}", f"one of {known}")
    chosen = [image for image in images if image[key] in groups]
    kept = {image.get("id") for image in chosen}
    given = document.get("annotations", ())
    annotations = [a for a in given if isinstance(a, dict) and a.get("image_id") in kept]
    return {**document, "images": chosen, "annotations": annotations}


def in_sequences(document: Any, asked: Sequences, where: Path) -> dict[str, Any]:
    """The wanted groups as sequences of image files, each in its order. Raises InputError as of_groups does."""
    chosen = of_groups(document, asked.by, asked.only, where)
    videos = [{"id": number, "name": f"{asked.by}-{group}"} for number, group in enumerate(asked.only)]
    images = []
    for image in chosen["images"]:
        place = _value(image, asked.order, f"{where} images.id={image.get('id')}.{asked.order}")
        if not isinstance(place, int):
            raise InputError(f"{where} images.id={image.get('id')}.{asked.order}", repr(place), "a number")
        images.append(image | {"video_id": asked.only.index(image[asked.by]), "frame_id": place})
    return chosen | {"images": images, "videos": videos}


def _value(image: Any, key: str, where: str) -> int | str:
    value = image.get(key) if isinstance(image, dict) else None
    if not isinstance(value, int | str):
        raise InputError(where, repr(value), "a number or a text, to tell images apart by")
    return value

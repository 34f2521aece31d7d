"""Confirmed and rejected pictures as a COCO data set, for training.

A picture is a crop about a place. It has one annotation, of the class of the place or, if it was rejected, of
``not CLASS``. Its box is the whole picture: nobody has drawn one; ``iscrowd`` is 0, and ``box`` says so.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from PIL import Image

from pipeline.storage.whole_or_nothing import make_folder, write_bytes, write_text
from pipeline.view.places import Place

FILE, PICTURES = "annotations.json", "images"


def write_coco(
    folder: Path, places: Sequence[Place], crop: Callable[[int, int], bytes | None]
) -> tuple[int, int]:
    """Write the data set; pictures written, and those that are not to be had. crop(place, number of its sighting).

    Places about which reviewers disagree, or whose words cancel, are left out.
    """
    make_folder(folder / PICTURES)
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    missing = 0
    decided = [place for place in places if place.net and not place.conflict]
    names = sorted({_category(place) for place in decided})
    for place in decided:
        for number in range(max(1, len(place.sightings))):
            data = crop(place.id, number)
            if data is None:
                missing += 1
                continue
            name = f"place-{place.id}-{number}.png"
            write_bytes(folder / PICTURES / name, data)
            with Image.open(io.BytesIO(data)) as picture:
                width, height = picture.size
            seen = place.sightings[number] if place.sightings else {}
            images.append(
                {"id": len(images) + 1, "file_name": f"{PICTURES}/{name}", "width": width, "height": height}
                | {"stream": seen.get("stream"), "time_s": seen.get("time_s")}
            )
            annotations.append(
                {"id": len(annotations) + 1, "image_id": len(images), "iscrowd": 0, "area": width * height}
                | {"category_id": names.index(_category(place)) + 1, "bbox": [0, 0, width, height]}
                | {"box": "the whole picture", "decided_by": sorted({d.who for d in place.decisions})}
            )
    categories = [{"id": k + 1, "name": name} for k, name in enumerate(names)]
    content = {"images": images, "annotations": annotations, "categories": categories}
    write_text(folder / FILE, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    return len(images), missing


def _category(place: Place) -> str:
    return place.class_name if place.net > 0 else f"not {place.class_name}"

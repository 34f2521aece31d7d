"""COCO results, and the COCO file beside them that names the files of their image ids."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.ingest.text import read_text
from pipeline.mission.listed_frames import ListedRow, Listing


def parsed_json(path: Path, text: str, expected: str) -> Any:
    """The JSON document in a text; InputError with its line if there is none."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        at = f"{path}:{error.lineno}" if isinstance(error, json.JSONDecodeError) else path
        raise InputError(at, "text that is not JSON", expected) from None


def coco_images(path: Path) -> dict[str, Any]:
    """A COCO file that lists images, as plain values; InputError if it lists none."""
    expected = "a COCO file: images with id and file_name"
    document = parsed_json(path, read_text(path, expected), expected)
    if not isinstance(document, dict) or not isinstance(document.get("images"), list):
        raise InputError(path, "no images", expected)
    return document


def listing_of_coco(path: Path, document: Any, beside: dict[str, Any] | None) -> Listing:
    """COCO results: a list; or a whole COCO file whose annotations have scores."""
    if isinstance(document, dict):
        beside = beside or document
        document = document.get("annotations")
    if not isinstance(document, list):
        raise InputError(
            path, "no list of results", "[{image_id, category_id, bbox: [x, y, w, h], score}, ..]"
        )
    listing, pictures = Listing(), _pictures(path, beside)
    names = _category_names(beside)
    with_result = set()
    for number, result in enumerate(document):
        where = f"{path} {number}"
        row = _result(where, result, pictures, names)
        if isinstance(row, str):
            listing.leave_out(row, where)
        else:
            listing.rows.append(row)
        if isinstance(result, dict):
            with_result.add(str(result.get("image_id")))
    listing.pictures = [row for key, row in pictures.items() if key not in with_result]
    if not pictures and listing.rows and all(row.file.isdigit() for row in listing.rows):
        raise InputError(
            path, "image ids that are numbers", "--images with the COCO file that names their files"
        )
    return listing


def _pictures(path: Path, beside: dict[str, Any] | None) -> dict[str, ListedRow]:
    if beside is None:
        return {}
    videos = {
        v.get("id"): str(v.get("name", v.get("file_name", "")))
        for v in beside.get("videos") or ()
        if isinstance(v, dict)
    }
    rows = {}
    for image in beside.get("images") or ():
        if isinstance(image, dict) and "id" in image:
            frame = image.get("frame_id")
            rows[str(image["id"])] = ListedRow(
                f"{path} image {image['id']}",
                stream=videos.get(image.get("video_id"), ""),
                frame=frame if isinstance(frame, int) else None,
                file=str(image.get("file_name", "")),
                size=_size(image),
            )
    return rows


def _size(image: dict[str, Any]) -> tuple[float, float] | None:
    width, height = image.get("width"), image.get("height")
    sound = all(isinstance(v, int | float) and not isinstance(v, bool) and v > 0 for v in (width, height))
    return (float(width), float(height)) if sound else None  # type: ignore[arg-type]


def _category_names(beside: dict[str, Any] | None) -> dict[str, str]:
    categories = (beside or {}).get("categories") or ()
    return {
        str(c["id"]): str(c.get("name", c["id"])) for c in categories if isinstance(c, dict) and "id" in c
    }


def _result(
    where: str, result: Any, pictures: dict[str, ListedRow], names: dict[str, str]
) -> ListedRow | str:
    """The row of one result, or why there is none."""
    if not isinstance(result, dict):
        return "no result"
    sides, score, image = result.get("bbox"), result.get("score"), str(result.get("image_id", ""))
    if not isinstance(sides, list) or len(sides) != 4 or not all(_is_finite(v) for v in sides):
        return "no box of four numbers"
    if not _is_finite(score) or not 0.0 <= float(score) <= 1.0:  # type: ignore[arg-type]
        return "no score between 0 and 1"
    picture = pictures.get(image)
    if pictures and picture is None:
        return "image id that is not among the images"
    category = str(result.get("category_id", ""))
    x, y, w, h = map(float, sides)
    return ListedRow(
        where,
        stream=picture.stream if picture else "",
        frame=picture.frame if picture else None,
        file=picture.file if picture else image,
        box=(x, y, x + w, y + h),
        score=float(score),  # type: ignore[arg-type]
        label=names.get(category, category),
        size=picture.size if picture else None,
    )


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9

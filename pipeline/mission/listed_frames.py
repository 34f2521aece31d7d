"""Detections that somebody else made, as a file lists them: COCO results, or a table with a row per box."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.config.mission import Table
from pipeline.errors import InputError
from pipeline.ingest.tables.cells import number
from pipeline.ingest.tables.delimited import DelimitedTable, Row, read_table
from pipeline.ingest.tables.known_names import columns_by_names
from pipeline.ingest.tables.units import factor, split_unit
from pipeline.ingest.text import read_text

Box = tuple[float, float, float, float]
_EXPECTED = "COCO results (JSON), or a table (CSV) with a row per box"
_NAMES = {
    "stream": ("stream", "video", "drone", "sequence", "source", "camera"),
    "frame": ("frame", "frame_id", "frame_number", "frame_index", "frame_no", "frame_num"),
    "time": ("time", "time_s", "timestamp", "video_time", "t", "seconds", "datetime", "utc"),
    "file": ("file", "file_name", "image", "image_id", "image_name", "path"),
    "score": ("score", "confidence", "conf", "probability", "prob"),
    "label": ("class", "label", "category", "class_name", "category_id", "class_id", "name"),
}
#: the four columns of a box, and what they are
_BOXES = (
    ("corners", ("x0", "y0", "x1", "y1")),
    ("corners", ("x1", "y1", "x2", "y2")),
    ("corners", ("xmin", "ymin", "xmax", "ymax")),
    ("sides", ("x", "y", "w", "h")),
    ("sides", ("x", "y", "width", "height")),
    ("sides", ("left", "top", "width", "height")),
    ("sides", ("bb_left", "bb_top", "bb_width", "bb_height")),
    ("middle", ("xc", "yc", "w", "h")),
    ("middle", ("x_center", "y_center", "width", "height")),
)


@dataclass(frozen=True, slots=True)
class ListedRow:
    """One box, or a frame that was looked at and shows none (box None).

    where: file and line, or id. stream, file, label: as the file says them, empty if it does not. frame: a
    number; time: seconds or a date, as text. box: x0, y0, x1, y1, pixels of a picture of ``size`` (width,
    height; None: the stream's own). score: 0..1.
    """

    where: str
    stream: str = ""
    frame: int | None = None
    time: str = ""
    file: str = ""
    box: Box | None = None
    score: float = math.nan
    label: str = ""
    size: tuple[float, float] | None = None


@dataclass
class Listing:
    """rows: in any order. pictures: rows of pictures of which nobody said whether they were looked at.

    left_out: reason -> count; first: reason -> where it was met first. assumed: sentences.
    """

    rows: list[ListedRow] = field(default_factory=list)
    pictures: list[ListedRow] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)
    assumed: list[str] = field(default_factory=list)

    def leave_out(self, reason: str, where: str, count: int = 1) -> None:
        """Count what cannot be used, and remember the first."""
        self.left_out[reason] += count
        self.first.setdefault(reason, where)


def read_listing(path: Path, images: Path | None = None) -> Listing:
    """What a file lists. images: a COCO file that tells the file names of the results' image ids.

    Raises InputError if it is neither COCO nor a table with boxes and scores.
    """
    text = read_text(path, _EXPECTED)
    if text.lstrip()[:1] in ("[", "{"):
        return _coco(path, _json(path, text), None if images is None else _images(images))
    if images is not None:
        raise InputError(path, "a table, with --images", "COCO results, or no --images")
    return _table(path, read_table(path, text, Table()))


def _json(path: Path, text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        at = f"{path}:{error.lineno}" if isinstance(error, json.JSONDecodeError) else path
        raise InputError(at, "text that is not JSON", _EXPECTED) from None


def _images(path: Path) -> dict[str, Any]:
    document = _json(path, read_text(path, "a COCO file with images"))
    if not isinstance(document, dict) or not isinstance(document.get("images"), list):
        raise InputError(path, "no images", "a COCO file: images with id and file_name")
    return document


def _coco(path: Path, document: Any, beside: dict[str, Any] | None) -> Listing:
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
    for number_, result in enumerate(document):
        where = f"{path} {number_}"
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


def _table(path: Path, table: DelimitedTable) -> Listing:
    found = {key: table.index(c.name) for key, c in columns_by_names(table, _NAMES).items()}
    kind, box = _box_columns(path, table)
    for missing, needed in (("score", ("score",)), ("frame, time or file", ("frame", "time", "file"))):
        if not any(name in found for name in needed):
            raise InputError(
                path, f"no column {missing} among {', '.join(table.names[:12])}", _columns_expected()
            )
    listing = Listing()
    for reason, count in table.left_out.counts.items():
        listing.leave_out(reason.replace("_", " "), table.left_out.first[reason], count)
    scale_s = _time_scale(table, found.get("time"))
    for row in table.rows:
        listed = _listed(f"{path}:{row.line}", row, found, (kind, box), table.decimal, scale_s)
        if isinstance(listed, str):
            listing.leave_out(listed, f"{path}:{row.line}")
        else:
            listing.rows.append(listed)
    _scores_in_percent(listing)
    return listing


def _columns_expected() -> str:
    return "columns stream, frame or time or file, x, y, w, h or x0, y0, x1, y1, score, class"


def _box_columns(path: Path, table: DelimitedTable) -> tuple[str, list[int]]:
    for kind, names in _BOXES:
        indices = [columns_by_names(table, {"it": (name,)}).get("it") for name in names]
        if all(index is not None for index in indices):
            return kind, [table.index(column.name) or 0 for column in indices if column is not None]
    raise InputError(
        path, f"no four columns of a box among {', '.join(table.names[:12])}", _columns_expected()
    )


def _time_scale(table: DelimitedTable, index: int | None) -> float:
    unit = split_unit(table.names[index])[1] if index is not None else ""
    return (factor(unit, "duration") if unit else None) or 1.0


def _listed(
    where: str,
    row: Row,
    found: dict[str, int | None],
    box: tuple[str, list[int]],
    decimal: str,
    scale_s: float,
) -> ListedRow | str:
    def cell(name: str) -> str:
        index = found.get(name)
        return row.cells[index].strip() if index is not None and index < len(row.cells) else ""

    frame = number(cell("frame"), decimal)
    time = cell("time")
    if not math.isnan(seconds := number(time, decimal)):
        time = repr(seconds * scale_s)
    if not (math.isfinite(frame) or time or cell("file")):
        return "neither frame nor time"
    if math.isfinite(frame) and (frame != int(frame) or abs(frame) > 1e9):
        return "a frame that is no whole number"
    cells = [row.cells[i].strip() if i < len(row.cells) else "" for i in box[1]]
    if not any(cells):
        corners, score = None, math.nan
    else:
        corners, score = _corners(box[0], [number(c, decimal) for c in cells]), number(cell("score"), decimal)
        if corners is None:
            return "no box of four numbers"
        if not 0.0 <= score <= 100.0:
            return "no score between 0 and 1"
    whole = int(frame) if math.isfinite(frame) else None
    return ListedRow(where, cell("stream"), whole, time, cell("file"), corners, score, cell("label"))


def _corners(kind: str, values: list[float]) -> Box | None:
    if not all(math.isfinite(v) for v in values):
        return None
    a, b, c, d = values
    if kind == "corners":
        return a, b, c, d
    return (a, b, a + c, b + d) if kind == "sides" else (a - c / 2, b - d / 2, a + c / 2, b + d / 2)


def _scores_in_percent(listing: Listing) -> None:
    from dataclasses import replace

    if not any(row.score > 1.0 for row in listing.rows):
        return
    listing.rows = [replace(row, score=row.score / 100.0) for row in listing.rows]
    listing.assumed.append("scores are in percent: some are greater than 1")


def labels(rows: list[ListedRow]) -> Iterator[str]:
    """The labels of all boxes, each once, in order of their first row."""
    yield from dict.fromkeys(row.label for row in rows if row.box is not None)

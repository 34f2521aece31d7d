"""A table of detections, with a row per box."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from pipeline.errors import InputError
from pipeline.ingest.tables.cells import number
from pipeline.ingest.tables.delimited import DelimitedTable, Row
from pipeline.ingest.tables.known_names import columns_by_names
from pipeline.ingest.tables.units import factor, split_unit
from pipeline.mission.listed_frames import Box, ListedRow, Listing

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


def listing_of_table(path: Path, table: DelimitedTable) -> Listing:
    """The rows of a table; InputError if it lacks the columns of boxes, scores or frames."""
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
    if not any(row.score > 1.0 for row in listing.rows):
        return
    listing.rows = [replace(row, score=row.score / 100.0) for row in listing.rows]
    listing.assumed.append("scores are in percent: some are greater than 1")

"""The formats in which people have detections: COCO results, or a table with a row per box."""

from __future__ import annotations

from pathlib import Path

from pipeline.config.telemetry import Table
from pipeline.errors import InputError
from pipeline.ingest.tables.delimited import read_table
from pipeline.ingest.text import read_text
from pipeline.mission.coco_results import coco_images, listing_of_coco, parsed_json
from pipeline.mission.detection_table import listing_of_table
from pipeline.mission.listed_frames import Listing

_EXPECTED = "COCO results (JSON), or a table (CSV) with a row per box"


def read_listing(path: Path, images: Path | None = None) -> Listing:
    """What a file lists. images: a COCO file that tells the file names of the results' image ids.

    Raises InputError if it is neither COCO nor a table with boxes and scores.
    """
    text = read_text(path, _EXPECTED)
    if text.lstrip()[:1] in ("[", "{"):
        return listing_of_coco(
            path, parsed_json(path, text, _EXPECTED), None if images is None else coco_images(images)
        )
    if images is not None:
        raise InputError(path, "a table, with --images", "COCO results, or no --images")
    return listing_of_table(path, read_table(path, text, Table()))

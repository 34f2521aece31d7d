"""Rows of COCO files by their ids: each id once, and only of what is listed."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

from pipeline.evaluation.datasets.coco_format import CocoAnnotation, CocoId, CocoResult
from pipeline.evaluation.datasets.fault_log import FaultLog


def unique(rows: Iterable[Any], where: Path, kind: str, faults: FaultLog) -> dict[CocoId, Any]:
    """The rows by id; those without an id by their place. Raises InputError for an id that comes twice."""
    found: dict[CocoId, Any] = {}
    for k, row in enumerate(rows):
        key = f"without an id, {k}" if row.id is None else row.id
        if key in found:
            faults.report("duplicate_id", f"{where} {kind}.{k}.id", f"{row.id!r} again", "every id once")
        else:
            found[key] = row
    return found


def in_order(rows: dict[CocoId, Any]) -> list[Any]:
    """By rising id, numbers before texts."""
    return [rows[key] for key in sorted(rows, key=lambda key: (isinstance(key, str), key))]


def listed(
    rows: Iterable[tuple[str, CocoAnnotation | CocoResult]],
    images: Collection[CocoId],
    categories: Collection[CocoId],
    faults: FaultLog,
) -> Iterator[tuple[str, Any]]:
    """The rows of listed pictures and categories, each with where it stands. Raises InputError for others."""
    for where, row in rows:
        if row.image_id not in images:
            faults.report(
                "missing_image",
                f"{where}.image_id",
                f"{row.image_id!r}, no listed picture",
                "an id in images",
            )
        elif row.category_id not in categories:
            at, found = f"{where}.category_id", f"{row.category_id!r}, no listed category"
            faults.report("unknown_category", at, found, "an id in categories")
        else:
            yield where, row


def places(
    rows: tuple[CocoAnnotation, ...], where: Path, faults: FaultLog
) -> list[tuple[str, CocoAnnotation]]:
    """Annotations, each id once, with where they stand."""
    kept = unique(rows, where, "annotations", faults).values()
    return [(_place(where, k, row), row) for k, row in enumerate(kept)]


def _place(where: Path, number: int, row: CocoAnnotation) -> str:
    return f"{where} annotations.{number}" if row.id is None else f"{where} annotations.id={row.id}"

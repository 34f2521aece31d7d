"""Decided pictures as COCO, read again by pycocotools."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from PIL import Image

from pipeline.view.coco import FILE, write_coco
from pipeline.view.decisions import Decision
from pipeline.view.places import Place


def decision(kind: str, who: str = "Ana") -> Decision:
    return Decision(1, "2026-12-01T10:00:00Z", who, kind, 1, "person", 47.0, 8.0)  # type: ignore[arg-type]


def place(number: int, *decisions: Decision, sightings: int = 1) -> Place:
    seen = tuple({"stream": "one", "time_s": 2.0 * k} for k in range(sightings))
    return Place(number, "found", "person", 0.9, 47.0, 8.0, 0.0, 0.0, {}, seen, decisions)


def picture(place_id: int, number: int) -> bytes | None:
    if place_id == 4:
        return None
    buffer = io.BytesIO()
    Image.new("RGB", (30 + number, 20)).save(buffer, "PNG")
    return buffer.getvalue()


def test_confirmed_and_rejected_pictures_are_read_again(tmp_path: Path) -> None:
    coco_api = pytest.importorskip("pycocotools.coco")
    places = [
        place(1, decision("confirm"), sightings=2),
        place(2, decision("reject")),
        place(3, decision("reject"), decision("confirm", "Ben")),  # they disagree
        place(4, decision("confirm")),  # its video is gone
        place(5),
        place(6, decision("note")),
    ]
    assert write_coco(tmp_path, places, picture) == (3, 1)
    coco = coco_api.COCO(str(tmp_path / FILE))
    names = {c["id"]: c["name"] for c in coco.loadCats(coco.getCatIds())}
    found = [(coco.imgs[a["image_id"]]["file_name"], names[a["category_id"]]) for a in coco.anns.values()]
    assert found == [
        ("images/place-1-0.png", "person"),
        ("images/place-1-1.png", "person"),
        ("images/place-2-0.png", "not person"),
    ]
    for image in coco.imgs.values():
        with Image.open(tmp_path / image["file_name"]) as written:
            assert written.size == (image["width"], image["height"])


def test_nothing_decided_is_an_empty_data_set(tmp_path: Path) -> None:
    assert write_coco(tmp_path, [place(1)], picture) == (0, 0)
    assert (tmp_path / FILE).is_file()

"""Whatever happens to a file of detections, it is placed or refused in one line, in any order, and quickly."""

from __future__ import annotations

import json
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import InputError
from pipeline.mission.detection_files import read_listing
from pipeline.mission.listed_frames import ListedRow, Listing
from pipeline.mission.own_detections import OwnDetector, PlacedDetections, place
from pipeline.mission.picture_finder import Numbering
from tests.mutations import Longest, mutated
from tests.unit.mission.test_mission_own_detections import PERSON, filmed

CSV = "stream,frame,x,y,w,h,score,class\n" + "".join(
    f"{('one', 'two')[k % 2]},{k},{10 * k},20,30,40.5,0.{k + 10},person\n" for k in range(25)
)
COCO = json.dumps(
    {
        "images": [
            {"id": k, "file_name": f"one/{k:06d}.jpg", "width": 640, "height": 480} for k in range(20)
        ],
        "categories": [{"id": 1, "name": "person"}],
        "annotations": [
            {"image_id": k, "category_id": 1, "bbox": [10 * k, 20, 30, 40.5], "score": 0.5} for k in range(20)
        ],
    },
    indent=1,
)
ROWS = st.builds(
    ListedRow,
    st.just("x:1"),
    st.sampled_from(["one", "two", "three"]),
    st.integers(-1, 31),
    box=st.one_of(st.none(), st.just((1.0, 2.0, 30.0, 40.0)), st.just((5.0, 6.0, 70.0, 80.0))),
    score=st.sampled_from([0.1, 0.5, 0.9]),
    label=st.sampled_from(["person", "kite"]),
)


def placed_or_refused(path: Path) -> PlacedDetections | str:
    try:
        return place(read_listing(path), filmed("one", "two"), (PERSON,), OwnDetector())
    except InputError as error:
        return str(error)


def place_mutations(text: str, path: Path, seeds: range) -> int:
    count, longest = 0, Longest(2.0)
    for seed in seeds:
        path.write_bytes(mutated(text.encode(), random.Random(seed)))
        with longest.of(f"seed {seed}"):
            found = placed_or_refused(path)
        if isinstance(found, str):
            assert "\n" not in found
            continue
        count += 1
        assert all(
            np.isfinite(d.boxes_px).all() and d.scores.max(initial=0.0) <= 1.0 for d in found.detections
        )
    print(f"{count} of {len(seeds)} placed, longest {longest.seconds:.2f} s")
    return count


@pytest.mark.parametrize("text", [CSV, COCO], ids=["csv", "coco"])
def test_mutated_detections_are_placed_or_refused_in_one_line(tmp_path: Path, text: str) -> None:
    assert place_mutations(text, tmp_path / "dets", range(100)) >= 2


@pytest.mark.slow
@pytest.mark.parametrize("text", [CSV, COCO], ids=["csv", "coco"])
def test_a_thousand_mutated_detections_are_placed_or_refused_in_one_line(tmp_path: Path, text: str) -> None:
    assert place_mutations(text, tmp_path / "dets", range(100, 1100)) >= 20


@given(st.lists(ROWS, max_size=40), st.randoms(use_true_random=False))
def test_the_order_of_rows_never_matters(rows: list[ListedRow], chance: random.Random) -> None:
    one, other = (
        Listing(rows=[*rows, ListedRow("x:0", "one", 0)]),
        Listing(rows=[*rows, ListedRow("x:0", "one", 0)]),
    )
    chance.shuffle(other.rows)
    if rows and not any(row.label == "person" for row in rows if row.box is not None):
        return
    streams, detector = filmed("one", "two"), OwnDetector(min_score=0.2)
    first, second = (place(listing, streams, (PERSON,), detector) for listing in (one, other))
    assert [(d.order, d.boxes_px.tolist(), d.scores.tolist()) for d in first.detections] == [
        (d.order, d.boxes_px.tolist(), d.scores.tolist()) for d in second.detections
    ]
    assert one.left_out == other.left_out


@given(st.lists(ROWS.filter(lambda row: row.frame is not None and not 25 <= row.frame < 30), max_size=40))
def test_every_box_is_placed_or_counted(rows: list[ListedRow]) -> None:
    sure = ListedRow("x:0", "one", 0, box=(1.0, 2.0, 3.0, 4.0), score=0.3, label="person")
    listing = Listing(rows=[*rows, sure])
    placed = place(
        listing, filmed("one", "two"), (PERSON,), OwnDetector(min_score=0.2, numbering=Numbering(0))
    )
    boxes = sum(len(d.scores) for d in placed.detections)
    empty_elsewhere = sum(r.box is None and (r.stream == "three" or r.frame in (-1, 30, 31)) for r in rows)
    listed = sum(row.box is not None for row in listing.rows)
    assert boxes + listing.left_out.total() == listed + empty_elsewhere

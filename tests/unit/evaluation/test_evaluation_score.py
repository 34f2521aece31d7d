"""`searchlight score`: COCO files of every kind, read as strictly as `evaluate` reads them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.evaluation.metrics.score import score_files

CASES = Path(__file__).parents[4] / "shared/data/cases/evaluation"
BOX = [10.0, 10.0, 20.0, 40.0]


def truth(**changes):
    document = {
        "images": [{"id": k} for k in (3, 7)],
        "annotations": [
            {"id": k, "image_id": i, "category_id": c, "bbox": BOX, "area": 800.0, "iscrowd": 0}
            for k, (i, c) in enumerate([(3, 1), (3, 2), (7, 1)])
        ],
        "categories": [{"id": 1, "name": "person"}, {"id": 2, "name": "boat"}],
    }
    return document | changes


def found():
    return [
        {"image_id": i, "category_id": c, "bbox": BOX, "score": s}
        for i, c, s in [(3, 1, 0.9), (3, 2, 0.8), (7, 1, 0.7)]
    ]


@pytest.fixture
def score(tmp_path):
    def run(gt, dt):
        paths = tmp_path / "gt.json", tmp_path / "dt.json"
        for path, content in zip(paths, (gt, dt), strict=True):
            path.write_text(content if isinstance(content, str) else json.dumps(content))
        return score_files(*paths)

    return run


def to_find(scored) -> int:
    return int(scored.classes[-1][1])


def test_what_is_found_to_the_pixel_is_perfect(score):
    scored = score(truth(), found())
    assert (to_find(scored), scored.faults) == (3, [])
    assert scored.classes[-1][2] == "1.0000000000"


@pytest.mark.parametrize("name", ["null", "absent", "null in one", "null with another box"])
def test_an_area_that_is_not_stated_is_that_of_the_box(score, name):
    document = truth()
    document["annotations"][2]["bbox"] = [0, 0, 200, 200]  # large; the others are small
    document["annotations"][2]["area"] = 40000.0
    stated = score(document, found())
    for k, a in enumerate(document["annotations"]):
        if name == "absent":
            del a["area"]
        elif name == "null" or k == 2:
            a["area"] = None
    assert score(document, found()) == stated


@pytest.mark.parametrize(
    ("results", "kind"),
    [
        ({"annotations": found()}, "a dictionary"),
        ({}, "a dictionary"),
        ("null", "nothing"),
        ('"text"', "a text"),
        ("3", "a number"),
    ],
)
def test_results_that_are_no_list_are_named_and_not_the_truth(score, results, kind):
    with pytest.raises(InputError, match=rf"dt\.json: found {kind}; expected COCO's list"):
        score(truth(), results)


@pytest.mark.parametrize(
    ("spoil", "field"),
    [
        (lambda r: r[1].pop("score"), "1.score: found nothing"),
        (lambda r: r[2].update(score=None), "2.score: found None"),
        (lambda r: r[0].update(score="0.9"), "0.score: found '0.9'"),
        (lambda r: r[0].update(score=float("nan")), "0.score: found nan"),
        (lambda r: r[0].update(score=True), "0.score: found True"),
        (lambda r: r[1].update(bbox=BOX[:3]), "1.bbox"),
        (lambda r: r[1].update(bbox=[1, 2, float("inf"), 4]), "1.bbox.2: found inf"),
        (lambda r: r[1].update(bbox=[1, 2, -3, 4]), "1.bbox: found"),
        (lambda r: r[1].update(image_id=99), "1.image_id: found 99, no listed picture"),
        (lambda r: r[1].pop("category_id"), "1.category_id: found nothing"),
        (lambda r: r.append(7), "3: found 7"),
    ],
)
def test_a_fault_of_the_results_names_them_and_the_field(score, spoil, field):
    results = found()
    spoil(results)
    with pytest.raises(InputError) as raised:
        score(truth(), results)
    assert f"dt.json {field}" in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("spoil", "field"),
    [
        (lambda t: t["annotations"][1].update(area="big"), "annotations.1.area: found 'big'"),
        (lambda t: t["annotations"][1].update(area=-1.0), "annotations.1.area: found -1.0"),
        (lambda t: t["annotations"][1].update(image_id=99), "annotations.id=1.image_id: found 99"),
        (lambda t: t["annotations"][1].update(bbox=[1, 2, float("nan"), 3]), "annotations.id=1.bbox: found"),
        (lambda t: t["annotations"][1].update(id=0), "annotations.1.id: found 0 again"),
        (lambda t: t["images"].append({"id": 7}), "images.2.id: found 7 again"),
        (lambda t: t["categories"].append({"id": 1, "name": "x"}), "categories.2.id: found 1 again"),
        (lambda t: t.pop("categories"), "categories: found nothing"),
        (lambda t: t["images"][0].update(id=1.5), "images.0.id: found 1.5"),
        (lambda t: t["images"][0].update(id=None), "images.0.id: found None"),
        (lambda t: t["images"][0].update(id=True), "images.0.id: found True"),
    ],
)
def test_a_fault_of_the_truth_names_it_and_the_field(score, spoil, field):
    document = truth()
    spoil(document)
    with pytest.raises(InputError) as raised:
        score(document, found())
    assert f"gt.json {field}" in str(raised.value)


def unlisted_in_truth(t, r):
    t["annotations"][1]["category_id"] = 77


def unlisted_text_in_truth(t, r):
    t["annotations"][1]["category_id"] = "2"


def unlisted_in_results(t, r):
    r[1]["category_id"] = 77


def category_gone(t, r):
    del t["categories"][1]


@pytest.mark.parametrize(
    ("spoil", "files", "count", "left"),
    [
        (unlisted_in_truth, "gt.json", 1, 2),
        (unlisted_text_in_truth, "gt.json", 1, 2),
        (unlisted_in_results, "dt.json", 1, 3),
        (category_gone, "gt.json", 2, 2),
    ],
)
def test_boxes_of_a_category_that_is_not_listed_are_left_out_and_that_is_said(
    score, spoil, files, count, left
):
    document, results = truth(), found()
    spoil(document, results)
    scored = score(document, results)
    assert to_find(scored) == left
    (line,) = scored.faults
    assert line.startswith(f"unknown_category: {count} (boxes left out)")
    assert files in line


@pytest.mark.parametrize(
    "of",
    [str, lambda k: f"3e9c-{k}", lambda k: 10**18 + k, lambda k: -k, float, lambda k: k if k < 5 else str(k)],
)
def test_ids_of_any_kind_give_the_same_figures(score, of):
    document, results = truth(), found()
    for row in (*document["images"], *document["categories"], *document["annotations"]):
        row["id"] = of(row["id"])
    for row in (*document["annotations"], *results):
        row["image_id"], row["category_id"] = of(row["image_id"]), of(row["category_id"])
    scored = score(document, results)
    assert to_find(scored) == 3
    assert scored.classes[-1][2] == "1.0000000000"


def test_annotations_need_no_ids_and_nothing_found_is_worth_nothing(score):
    document = truth()
    for a in document["annotations"]:
        del a["id"]
    assert to_find(score(document, found())) == 3
    assert score(document, []).classes[-1][2] == "0.0000000000"


@pytest.mark.skipif(not CASES.is_dir(), reason=f"{CASES} is not there")
@pytest.mark.parametrize("name", ["dt_is_dict", "dt_no_score"])
def test_the_shared_faults_name_the_file_that_is_at_fault(name):
    with pytest.raises(InputError, match=rf"{name}\.dt\.json"):
        score_files(CASES / f"{name}.gt.json", CASES / f"{name}.dt.json")


@pytest.mark.skipif(not CASES.is_dir(), reason=f"{CASES} is not there")
def test_the_shared_null_area_and_unknown_category():
    sizes = score_files(CASES / "area_null.gt.json", CASES / "area_null.dt.json").sizes
    assert sizes[2][:2] == ("small", "0.2519801980")
    scored = score_files(CASES / "gt_unknown_category.gt.json", CASES / "gt_unknown_category.dt.json")
    assert to_find(scored) == 22
    assert "gt_unknown_category.gt.json annotations.id=1.category_id: found 77" in scored.faults[0]

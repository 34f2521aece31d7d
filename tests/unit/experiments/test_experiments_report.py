import json

import pytest
from matplotlib.figure import Figure

from pipeline.experiments.experiment_report import Experiment, Measure, write_experiment


def figure():
    drawn = Figure(figsize=(2, 2))
    drawn.add_subplot().plot([0, 1])
    return drawn


@pytest.mark.parametrize(
    ("wanted", "ours", "met"),
    [("<=", 0.4, True), ("<=", 0.41, False), (">=", 0.4, True), (">=", 0.39, False), (None, 9.0, None)],
)
def test_a_figure_is_reached_or_not(wanted, ours, met):
    assert Measure("error", ours, "m", "0.63 m", wanted, 0.4).met == met


def test_a_figure_that_is_not_a_number_is_not_reached():
    assert Measure("error", float("nan"), "m", "", "<=", 0.4).met is False


def test_the_report_has_figures_pictures_and_what_was_chosen(tmp_path):
    measures = [
        Measure("error <1 m>", 0.25, "m", "0.36 m", "<=", 0.3),
        Measure("nothing", float("nan"), "", ""),
    ]
    write_experiment(tmp_path, Experiment(3, "cells", "text", measures, {"maps": figure()}, {"seed": "7"}))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for text in (
        "Experiment 3: cells",
        "error &lt;1 m&gt;",
        "0.36 m",
        "reached",
        "seed",
        "data:image/png;base64,",
    ):
        assert text in page, text
    assert (tmp_path / "maps.png").read_bytes()[:4] == b"\x89PNG"
    found = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert found["measures"][0] == {
        "name": "error <1 m>", "ours": 0.25, "unit": "m", "paper": "0.36 m", "wanted": "<= 0.3", "met": True,
    }  # fmt: skip
    assert found["measures"][1]["ours"] is None

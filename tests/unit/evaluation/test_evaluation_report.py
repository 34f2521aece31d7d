"""What is made of results for people: verdicts on the paper's claims, tables, pictures, one page."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
from made_up import BITRATES, CODECS, ap_like_the_paper, results

from pipeline.evaluation.report.examples import Example
from pipeline.evaluation.report.paper_claims import shapes
from pipeline.evaluation.report.report import render_report, report_figures, verdict
from pipeline.evaluation.report.results import load_results
from pipeline.evaluation.report.tables import CELL_COLUMNS, cells_csv, times_csv


def verdicts(**changes) -> list[str]:
    return [shape.verdict for shape in shapes(results(**changes))]


def test_results_like_the_papers_hold_all_its_claims():
    assert verdicts() == ["holds"] * 6


def test_a_loss_at_1_mbps_alone_still_holds_down_to_2_5():
    def ap(detector, codec, bitrate):
        return ap_like_the_paper(detector, codec, bitrate) - (
            0.1 if bitrate == 1e6 and detector == "large" else 0
        )

    shape = shapes(results(ap=ap))[0]
    assert shape.verdict == "holds"
    assert "large h264 -0.100 (17%) at 1 Mbps" in shape.found


def test_each_claim_can_fail():
    def worse(detector, codec, bitrate):
        return 0.6 - (0.2 if bitrate < 20e6 else 0.0)

    assert verdicts(ap=worse)[0] == "does not hold"

    def h264_best(detector, codec, bitrate):
        swapped = {"h264": "h265", "h265": "h264"}.get(codec, codec)
        return ap_like_the_paper(detector, swapped, bitrate)

    assert verdicts(ap=h264_best)[1:3] == ["does not hold"] * 2
    assert verdicts(small=-0.5)[3] == "does not hold"
    assert verdicts(ap=lambda d, c, b: 0.6 if d == "tiny" else 0.65)[4] == "does not hold"


def test_a_codec_that_sends_more_than_it_was_asked_for_is_seen_through():
    """VP9 beside H.264 at the bitrates asked for, but only since it sends four times as much."""
    found = results()
    cells = [
        c.model_copy(update={"obtained_bps": 4 * c.bitrate_bps}) if c.codec == "vp9" else c
        for c in found.cells
    ]
    asked, obtained = shapes(found.model_copy(update={"cells": tuple(cells)}))[1:3]
    assert (asked.verdict, obtained.verdict) == ("holds", "does not hold")


def test_what_was_not_measured_cannot_be_told():
    one = results(detectors=("tiny",))
    only = one.model_copy(update={"cells": tuple(c for c in one.cells if c.codec in (None, "h264"))})
    assert [shape.verdict for shape in shapes(only)][1:] == ["cannot be told"] * 5


def test_a_difference_that_chance_explains_is_none():
    def noise(detector, codec, bitrate):
        return 0.6 - (0.02 if bitrate == 2.5e6 else 0.0)

    steady = results(ap=noise)
    assert shapes(steady)[0].verdict == "does not hold"
    rng = np.random.default_rng(3)
    loose = [
        c.model_copy(
            update={
                "replicates": c.replicates.model_copy(update={"ap": tuple(rng.normal(c.figures.ap, 0.1, 50))})
            }
        )
        for c in steady.cells
    ]
    assert shapes(steady.model_copy(update={"cells": tuple(loose)}))[0].verdict == "holds"


def test_the_tables_hold_every_cell_and_setup():
    rows = list(csv.DictReader(io.StringIO(cells_csv(results()))))
    assert tuple(rows[0]) == CELL_COLUMNS
    assert len(rows) == 2 * (1 + len(CODECS) * len(BITRATES)) * 5
    row = next(
        r for r in rows if r["detector"] == "large" and r["codec"] == "vp9" and r["bitrate_kbps"] == "50.0"
    )
    assert (row["size"], row["ap"], row["obtained_kbps"]) == ("all", "0.3", "52.5")
    assert [r["mean_ms"] for r in csv.DictReader(io.StringIO(times_csv(results())))] == ["4.0", "40.0"]


def example(codec, bitrate):
    box = np.array([[5.0, 5, 20, 30]])
    return Example(codec, bitrate, np.zeros((36, 64, 3), np.uint8), box, box[:0])


@pytest.fixture(scope="module")
def page():
    shown = [example(None, None), example("h264", 50e3), example("vp9", 50e3)]
    figures = report_figures(results(), shown)
    assert [f.name for f in figures] == ["accuracy", "sizes", "lrp", "context", "frames", "times"]
    assert all(f.png.startswith(b"\x89PNG") for f in figures)
    return render_report(results(), figures)


def test_the_page_is_whole_offline_and_says_that_the_scenes_are_simulated(page):
    assert page.count("data:image/png;base64,") == 6
    assert "http://" not in page.replace("http-equiv", "")
    assert "https://" not in page
    assert "simulated-scene accuracy" in page
    assert "16 / 79 / 5" in page


def test_texts_from_outside_are_escaped(page):
    assert "<b>machine</b>" not in page
    assert "&lt;b&gt;machine" in page


def test_a_page_without_codecs_or_times_is_still_one():
    one = results()
    bare = one.model_copy(update={"cells": one.cells[:2], "timings": ()})
    assert report_figures(bare, []) == []
    assert "Does what the paper reports" not in render_report(bare, [])
    assert "simulated-scene" not in render_report(bare.model_copy(
        update={"provenance": bare.provenance.model_copy(update={"simulated": False})}), [])  # fmt: skip


def test_the_verdict_names_the_best_and_how_far_down_it_holds():
    assert verdict(results()) == "Best: large, ap50 0.600 (h264, 1Mbps); 95 % of it down to 1Mbps."


def test_results_go_to_a_file_and_back(tmp_path):
    (tmp_path / "results.json").write_text(results().model_dump_json())
    assert load_results(tmp_path / "results.json") == results()

"""From results to the pool that allocation reads, and pools side by side."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from made_up import BITRATES, CODECS, results, timing

from pipeline.config.evaluation import load_evaluation
from pipeline.config.pool import Calibration, load_pool
from pipeline.errors import InputError
from pipeline.evaluation.datasets.dataset import sha256_of_file
from pipeline.evaluation.measuring.operating_points import FoundShare, MeasuredOperatingPoint
from pipeline.evaluation.pool.operating_points_into import put_operating_points
from pipeline.evaluation.pool.pool_file import write_pool
from pipeline.evaluation.pool.pool_tools import assume, differences, merge, shown

POOLS = Path(__file__).parents[3] / "configs/pools"


@pytest.fixture
def pool_file(tmp_path):
    path = tmp_path / "pool.yaml"
    write_pool(path, results())
    return path


def test_the_pool_holds_what_was_measured(pool_file):
    tiny, large = load_pool(pool_file).detectors
    assert [row.bitrate for row in large.accuracy] == list(BITRATES)
    assert large.accuracy[0].accuracy == pytest.approx(0.1)
    assert tiny.memory == 100e6
    (time,) = large.times
    assert (time.minimum, time.mean, time.p95, time.maximum) == pytest.approx((0.036, 0.04, 0.06, 0.08))
    assert (time.provider, time.threads) == ("cpu", 1)
    assert [(s.detectors, s.factor) for s in large.sharing] == [(2, 1.4), (3, 2.2)]
    assert {(row.size, row.bitrate) for row in large.accuracy_by_size} == {
        (size, b) for size in ("small", "medium") for b in BITRATES
    }
    assert len(large.accuracy_by_codec) == len(CODECS) * len(BITRATES)
    row = large.accuracy_by_codec[0]
    assert (row.codec, row.obtained, row.largest_packet) == (
        "h264",
        pytest.approx(52.5e3),
        pytest.approx(0.4),
    )
    assert row.low < row.accuracy < row.high
    assert large.accuracy_by_context[0].person_px_from == 32.0
    assert large.sha256 == "1" * 64


def test_the_pool_says_that_simulated_accuracy_is_simulated(pool_file, tmp_path):
    assert "simulated-scene accuracy" in load_pool(pool_file).provenance["accuracy"]
    write_pool(tmp_path / "real.yaml", results(simulated=False))
    assert "simulated" not in load_pool(tmp_path / "real.yaml").provenance["accuracy"]


def test_what_allocation_could_not_use_is_not_written(tmp_path):
    for changes, message in (({"timings": ()}, "no setup"), ({"codec": "mpeg"}, "no ap50 under mpeg")):
        with pytest.raises(InputError, match=message):
            write_pool(tmp_path / "pool.yaml", results(**changes))
        assert not list(tmp_path.iterdir())


def test_a_pool_without_the_finer_figures_reads_as_before():
    for name in ("paper-allocation", "paper"):
        pool = load_pool(POOLS / f"{name}.yaml")
        assert all(d.accuracy_by_size == () and d.sharing == () for d in pool.detectors)


@pytest.mark.parametrize("name", ["demo", "simulated"])
def test_the_shipped_pools_were_measured_with_the_shipped_detectors(name):
    pool = load_pool(POOLS / f"{name}.yaml")
    for d in pool.detectors:
        assert d.sha256 == sha256_of_file(d.model)
        assert d.calibration is not None
        assert {s.detectors for s in d.sharing} == {2, 3}
    assert "simulated-scene accuracy" in pool.provenance["accuracy"]


@pytest.mark.parametrize(
    ("field", "row", "message"),
    [
        ("sharing", {"detectors": 2, "factor": 0.9}, "greater than or equal to 1"),
        ("sharing", {"detectors": 1, "factor": 1.5}, "greater than or equal to 2"),
        ("accuracy_by_size", {"bitrate": {"kbps": 5}, "size": "huge", "accuracy": 0.5}, "huge"),
        ("accuracy_by_codec", {"bitrate": {"kbps": 5}, "codec": "mpeg", "accuracy": 0.5}, "mpeg"),
    ],
)
def test_rows_that_make_no_sense_are_refused_with_their_field(pool_file, field, row, message):
    document = yaml.safe_load(pool_file.read_text())
    document["detectors"][0][field] = [row]
    pool_file.write_text(yaml.safe_dump(document))
    with pytest.raises(InputError, match=message) as raised:
        load_pool(pool_file)
    assert f"detectors.0.{field}.0" in str(raised.value)


def test_rows_come_once(pool_file):
    document = yaml.safe_load(pool_file.read_text())
    document["detectors"][0]["sharing"] *= 2
    pool_file.write_text(yaml.safe_dump(document))
    with pytest.raises(InputError, match="again"):
        load_pool(pool_file)


def test_merging_adds_detectors_and_machines(pool_file, tmp_path):
    elsewhere = tmp_path / "far/pool.yaml"
    elsewhere.parent.mkdir()
    more = results().model_copy(
        update={"timings": (timing("tiny", 0.02, "onboard"), timing("large", 0.2, "onboard"))}
    )
    write_pool(elsewhere, more)
    other = tmp_path / "other.yaml"
    write_pool(other, results(detectors=("third",)))
    merge([pool_file, elsewhere, other], tmp_path / "merged.yaml")
    merged = load_pool(tmp_path / "merged.yaml")
    assert [(d.id, [t.machine for t in d.times]) for d in merged.detectors] == [
        ("tiny", ["workstation", "onboard"]),
        ("large", ["workstation", "onboard"]),
        ("third", ["workstation"]),
    ]
    assert merged.detectors[0].model.resolve() == load_pool(pool_file).detectors[0].model.resolve()
    assert len(merged.provenance["merged"]) == 3


def test_one_pool_alone_is_the_same_pool_in_another_place(pool_file, tmp_path):
    (tmp_path / "far").mkdir()
    merge([pool_file], tmp_path / "far" / "pool.yaml")
    old, new = load_pool(pool_file), load_pool(tmp_path / "far" / "pool.yaml")
    assert new.provenance == old.provenance
    assert [d.model.resolve() for d in new.detectors] == [d.model.resolve() for d in old.detectors]
    assert list(differences(old, new)) == []


def test_pools_that_contradict_each_other_are_not_merged(pool_file, tmp_path):
    other = tmp_path / "other.yaml"
    write_pool(other, results(ap=lambda *_: 0.5))
    with pytest.raises(InputError, match=r"other.yaml detectors.tiny.accuracy"):
        merge([pool_file, other], tmp_path / "merged.yaml")
    assert not (tmp_path / "merged.yaml").exists()


def test_a_machine_that_was_not_measured_is_assumed_and_the_pool_says_so(pool_file, tmp_path):
    out = tmp_path / "more" / "assumed.yaml"
    out.parent.mkdir()
    assume(pool_file, out, machine="onboard", like="workstation", slower=6.0, detectors=("large",))
    before, pool = load_pool(pool_file), load_pool(out)
    (large,) = pool.detectors
    measured, assumed = large.times
    assert (measured.machine, assumed.machine) == ("workstation", "onboard")
    assert (assumed.mean, assumed.maximum) == pytest.approx((6 * measured.mean, 6 * measured.maximum))
    assert pool.assumed == ("machine type onboard: 6 times as slow as workstation, which was measured",)
    assert large.model.resolve() == before.detectors[1].model.resolve()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"machine": "workstation"}, "workstation, which is measured"),
        ({"like": "abacus"}, "no abacus.*one of workstation"),
        ({"detectors": ("huge",)}, "no huge.*one of large, tiny"),
    ],
)
def test_assumptions_without_ground_are_refused(pool_file, tmp_path, changes, message):
    asked = {"machine": "onboard", "like": "workstation", "slower": 6.0} | changes
    with pytest.raises(InputError, match=message):
        assume(pool_file, tmp_path / "out.yaml", **asked)
    assert not (tmp_path / "out.yaml").exists()


def test_the_calibration_of_scores_is_in_the_pool(tmp_path):
    found = results()
    first = found.detectors[0].model_copy(update={"calibration": Calibration(scale=2.0, offset=0.5)})
    write_pool(tmp_path / "pool.yaml", found.model_copy(update={"detectors": (first, found.detectors[1])}))
    tiny, large = load_pool(tmp_path / "pool.yaml").detectors
    assert (tiny.calibration.scale, tiny.calibration.offset) == (2.0, 0.5)
    assert large.calibration is None


def test_differences_are_named_and_there_are_none_between_equals(pool_file, tmp_path):
    pool = load_pool(pool_file)
    assert list(differences(pool, pool)) == []
    other = tmp_path / "other.yaml"
    write_pool(other, results(detectors=("tiny", "third")))
    found = list(differences(pool, load_pool(other)))
    assert ("large", "detector", "there", "–") in found
    assert ("third", "detector", "–", "there") in found
    slower = results().model_copy(update={"timings": (timing("tiny", 0.005), timing("large", 0.04))})
    write_pool(other, slower)
    assert ("tiny", "mean on workstation", "4 ms", "5 ms") in list(differences(pool, load_pool(other)))


def test_a_pool_is_shown_detector_by_detector(pool_file):
    head, tiny, large = shown(load_pool(pool_file))
    assert head[0] == "detector"
    assert (tiny[0], large[0]) == ("tiny", "large")
    assert "workstation 40.0 (80.0) ms" in large
    assert "x 1.40" in large


def with_points(threshold=0.4, **changes):
    """Made-up results whose detectors have an operating point at 50 kbps."""
    point = MeasuredOperatingPoint(
        codec="h264", bitrate_bps=50e3, picture_width=1024, calibration=Calibration(scale=2.0, offset=-1.0),
        found=(FoundShare(person_px_from=24.0, person_px_below=32.0, share=0.25, people=40),),
        false_boxes=0.5, right=30, wrong=60,
    )  # fmt: skip
    known = results(**changes)
    detectors = [
        d.model_copy(update={"operating_points": (point,), "score_threshold": threshold})
        for d in known.detectors
    ]
    return known.model_copy(update={"detectors": tuple(detectors)})


def test_operating_points_of_a_later_evaluation_come_into_a_pool_whose_times_stay(pool_file, tmp_path):
    before = load_pool(pool_file)
    own = before.detectors[0].score_threshold
    (tmp_path / "results.json").write_text(with_points(own, timings=()).model_dump_json())
    (tmp_path / "deeper").mkdir()
    out = tmp_path / "deeper" / "pool.yaml"
    put_operating_points(pool_file, tmp_path / "results.json", out)
    after = load_pool(out)
    for old, new in zip(before.detectors, after.detectors, strict=True):
        (point,) = new.operating_points
        assert (point.codec, point.bitrate, point.calibration.scale, point.false_boxes) == (
            "h264",
            5e4,
            2.0,
            0.5,
        )
        assert [(row.share, row.people) for row in point.found] == [(0.25, 40)]
        assert new.model.resolve() == old.model.resolve()
        unchanged = {"operating_points", "model", "card"}
        assert new.model_dump(exclude=unchanged) == old.model_dump(exclude=unchanged)
    assert after.provenance["times"] == before.provenance["times"]
    assert after.provenance["operating_points"]["command"] == "searchlight pool operating-points"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (lambda: with_points(0.77), r"tiny\.score_threshold.*found 0\.\d+; expected 0\.77"),
        (lambda: with_points(detectors=("large",)), r"tiny.*a detector that was not evaluated.*one of large"),
        (results, r"tiny.*an evaluation without operating points.*transcoding"),
    ],
)
def test_operating_points_of_other_boxes_are_refused_and_nothing_is_written(
    pool_file, tmp_path, given, words
):
    (tmp_path / "results.json").write_text(given().model_dump_json())
    with pytest.raises(InputError, match=words):
        put_operating_points(pool_file, tmp_path / "results.json", tmp_path / "new.yaml")
    assert not (tmp_path / "new.yaml").exists()


def test_operating_points_of_another_file_are_refused(pool_file, tmp_path):
    document = yaml.safe_load(pool_file.read_text())
    document["detectors"][1]["sha256"] = "2" * 64
    pool_file.write_text(yaml.safe_dump(document))
    own = load_pool(pool_file).detectors[0].score_threshold
    (tmp_path / "results.json").write_text(with_points(own).model_dump_json())
    with pytest.raises(InputError, match=r"large\.sha256.*the file that was evaluated, 1111"):
        put_operating_points(pool_file, tmp_path / "results.json", tmp_path / "new.yaml")


def test_the_shipped_operating_points_are_measured_at_the_pool_s_own_thresholds():
    evaluation = load_evaluation(POOLS.parent / "evaluations" / "operating-points.yaml")
    rows = {d.id: d for d in load_pool(POOLS / "simulated.yaml").detectors}
    assert {d.id for d in evaluation.detectors} == set(rows)
    for detector in evaluation.detectors:
        row = rows[detector.id]
        assert (detector.score_threshold, detector.calibration) == (row.score_threshold, row.calibration)
        assert detector.model.resolve() == row.model.resolve()

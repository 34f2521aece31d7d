"""Which units share the decoding of their source."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.evaluation.measuring.bundles import bundles, cost
from pipeline.evaluation.measuring.unit import Condition, Unit

CODECS = ("h264", "h265", "vp9", "av1")
BITRATES = (50e3, 100e3, 250e3, 500e3, 1e6, 2.5e6, 5e6, 10e6, 20e6)


SOURCE = Condition()


def unit(sequence="a", condition=SOURCE, packets=None) -> Unit:
    return Unit(
        sequence=sequence, files=(Path(f"{sequence}.mp4"),), is_video=True, frame_rate_hz=30.0,
        kept=tuple(range(300)), looked={0: 0, 15: 1}, size=(512, 288), condition=condition, keyframe_interval=60,
        models=(), score_cutoff=0.05, packets=packets,
    )  # fmt: skip


def grid(sequence="a") -> list[Unit]:
    conditions = [Condition(), *(Condition(c, b) for c in CODECS for b in BITRATES)]
    return [unit(sequence, condition) for condition in conditions]


@pytest.mark.parametrize(("workers", "pieces"), [(1, 4), (2, 4), (3, 3), (4, 4), (8, 8), (64, 37)])
def test_the_papers_grid_decodes_a_sequence_no_more_often_than_it_has_codecs(workers, pieces):
    made = bundles(grid(), workers)
    assert len(made) == pieces  # 37 before; an eighth of that was asked
    costs = [sum(map(cost, bundle)) for bundle in made]
    if workers <= 4:
        assert max(costs) <= 1.05 * min(costs)


@pytest.mark.parametrize("workers", [1, 2, 3, 8])
@pytest.mark.parametrize("sequences", [("a",), ("a", "b", "c")])
def test_every_unit_is_in_one_bundle_of_its_sequence_the_costliest_first(workers, sequences):
    units = [u for name in sequences for u in grid(name)]
    made = bundles(units, workers)
    assert sorted(map(repr, (u for bundle in made for u in bundle))) == sorted(map(repr, units))
    assert all(len({u.sequence for u in bundle}) == 1 for bundle in made)
    costs = [sum(map(cost, bundle)) for bundle in made]
    assert costs == sorted(costs, reverse=True)
    if len(sequences) >= workers:
        assert len(made) == len(CODECS) * len(sequences)


def test_units_whose_stream_is_kept_need_no_source_and_stay_alone(tmp_path):
    kept = tmp_path / "x.packets"
    kept.write_bytes(b"")
    units = [
        unit(condition=Condition("vp9", 1e6), packets=kept),
        unit(condition=Condition("vp9", 2e6), packets=tmp_path / "absent.packets"),
        unit(condition=Condition("vp9", 3e6)),
    ]
    assert sorted(map(len, bundles(units, 1))) == [1, 2]
    assert bundles([], 3) == []


def test_pictures_alone_are_looked_at_one_by_one():
    stills = [replace(unit(f"{k}.jpg"), size=None) for k in range(5)]
    assert [len(bundle) for bundle in bundles(stills, 2)] == [1] * 5

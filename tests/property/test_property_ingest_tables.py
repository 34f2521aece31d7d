"""Whatever happens to a table, it is read or refused in one line, and quickly."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.config.telemetry import Column, Telemetry
from pipeline.errors import InputError
from pipeline.ingest.increasing import longest_increasing
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.track import Track
from tests.dialects import airdata_csv, column_table, dji_flight_record_csv, litchi_csv
from tests.mutations import Longest, mutated

MOST_S = 2.0
WRITERS: dict[str, tuple[Callable[..., None], str]] = {
    "airdata": (airdata_csv.write, "airdata-csv"),
    "litchi": (litchi_csv.write, "litchi-csv"),
    "flight record": (dji_flight_record_csv.write, "dji-flight-record-csv"),
    "column table": (column_table.write, "table"),
}
COLUMNS = {name: Column(**spelt) for name, spelt in column_table.COLUMNS.items()}


def track() -> Track:
    times_s = np.arange(40) * 0.1
    ones = np.ones(40)
    heights = 120.0 * ones, 20.0 * ones
    return Track(
        1_781_429_400_000_000_000, times_s, 58.4 * ones, 15.5 * ones, *heights, ones, -ones, 0 * ones
    )


def read_or_refuse(telemetry: Telemetry) -> Track | str:
    try:
        return read_telemetry(telemetry)
    except InputError as error:
        return str(error)


def read_mutations(name: str, folder: Path, seeds: range) -> int:
    """How many of the mutations could be read. Fails on a traceback, a second line, or more than 2 s."""
    write, form = WRITERS[name]
    path = folder / "log.csv"
    write(path, track())
    whole, read, longest = path.read_bytes(), 0, Longest(MOST_S)
    for seed in seeds:
        path.write_bytes(mutated(whole, random.Random(seed)))
        telemetry = Telemetry(file=path, format=form, columns=COLUMNS if form == "table" else {})
        with longest.of(f"seed {seed}"):
            found = read_or_refuse(telemetry)
        if isinstance(found, str):
            assert "\n" not in found
            continue
        read += 1
        assert np.all(np.diff(found.times_s) > 0)
        # of a receiver that never had a fix rows without a position stay, for their angles
        assert np.all(np.abs(found.latitude_deg[found.has_position]) <= 90)
        assert found.has_position.all() or not found.has_position.any()
    print(f"{name}: {read} of {len(seeds)} read, longest {longest.seconds:.2f} s")
    return read


@pytest.mark.parametrize("name", WRITERS)
def test_a_mutated_table_is_read_or_refused_in_one_line(tmp_path: Path, name: str) -> None:
    assert read_mutations(name, tmp_path, range(100)) > 20


@pytest.mark.slow
@pytest.mark.parametrize("name", WRITERS)
def test_a_thousand_mutated_tables_are_read_or_refused_in_one_line(tmp_path: Path, name: str) -> None:
    assert read_mutations(name, tmp_path, range(100, 1100)) > 200


@given(st.lists(st.one_of(st.integers(0, 12).map(float), st.just(float("nan"))), max_size=9))
def test_the_longest_increasing_rows_are_as_many_as_brute_force_finds(values: list[float]) -> None:
    best = [1] * len(values)
    for i, value in enumerate(values):
        best[i] = (
            max([best[j] + 1 for j in range(i) if values[j] < value], default=1) if np.isfinite(value) else 0
        )
    rows = longest_increasing(np.array(values, np.float64))
    assert len(rows) == max(best, default=0)
    assert np.all(np.diff(np.array(values)[rows]) > 0)

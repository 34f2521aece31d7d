"""Mutated binary logs: read or refused in one line, soon, in little memory, without bringing the process down."""

from __future__ import annotations

import random
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.track import Track
from tests.dialects import ardupilot_bin, gpmf, klv, mavlink_tlog, ulog
from tests.dialects.tracks import flight
from tests.mutations import Longest

MOST_S, MOST_BYTES = 2.0, 100_000_000


def write_stream(path: Path, rows: Track) -> None:
    klv.write_stream(path, klv.packets(rows), rows.times_s.tolist())


WRITERS: dict[str, tuple[str, Callable[[Path, Track], None]]] = {
    "klv": ("misb-klv", klv.write),
    "klv in ts": ("misb-klv", write_stream),
    "tlog": ("mavlink-tlog", mavlink_tlog.write),
    "tlog, mount": ("mavlink-tlog", partial(mavlink_tlog.write, gimbal="orientation")),
    "dataflash": ("ardupilot-bin", ardupilot_bin.write),
    "ulog": ("px4-ulog", ulog.write),
    "gpmf": ("gopro-gpmf", gpmf.write),
    "gps9": ("gopro-gpmf", partial(gpmf.write, kind="GPS9")),
}


def mutated(data: bytes, chance: random.Random) -> bytes:
    """One to twenty changes: bytes, numbers that are too large, pieces lost, twice, swapped, the end cut off."""
    result = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 5, 20))):
        at, kind = chance.randrange(len(result) or 1), chance.randrange(7)
        if kind == 0:
            result[at : at + 1] = bytes([chance.randrange(256)])
        elif kind == 1:
            result[at : at + 4] = chance.choice(
                (b"\xff" * 4, bytes(4), b"\x7f\xff\xff\xff", b"\x00\x00\x00\x80")
            )
        elif kind == 2:
            del result[at : at + chance.randint(1, 300)]
        elif kind == 3 and chance.random() < 0.3:
            del result[at:]
        elif kind == 4:
            result[at:at] = result[at : at + chance.randint(1, 500)]
        elif kind == 5:
            result[at:at] = chance.randbytes(chance.randint(1, 100))
        else:
            result[at : at + 8] = chance.randbytes(8)
    return bytes(result)


def read_or_refuse(telemetry: Telemetry) -> Track | str:
    try:
        return read_telemetry(telemetry)
    except InputError as error:
        return str(error)


def read_mutations(name: str, folder: Path, seeds: range) -> int:
    """How many could be read. Fails on a traceback, a second line, time, memory, or a track that is not in order."""
    form, write = WRITERS[name]
    path = folder / "log.bin"
    write(path, flight())
    whole, read, longest = path.read_bytes(), 0, Longest(MOST_S)
    tracemalloc.start()
    try:
        for seed in seeds:
            path.write_bytes(mutated(whole, random.Random(seed)))
            with longest.of(f"seed {seed}"):
                track = read_or_refuse(Telemetry(file=path, format=form))
            if isinstance(track, str):
                assert "\n" not in track, seed
            else:
                read += 1
                assert len(track.times_s) >= 1, seed
                assert (np.diff(track.times_s) > 0.0).all(), seed
                assert np.nanmax(np.abs(track.latitude_deg), initial=0.0) <= 90.0, seed
            assert tracemalloc.get_traced_memory()[1] < MOST_BYTES, seed
    finally:
        tracemalloc.stop()
    print(f"{name}: {read} of {len(seeds)} read, longest {longest.seconds:.2f} s")
    return read


@pytest.mark.parametrize("name", WRITERS)
def test_a_damaged_log_is_read_or_refused(name: str, tmp_path: Path) -> None:
    assert read_mutations(name, tmp_path, range(50)) > 0


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", WRITERS)
def test_a_thousand_damaged_logs_are_read_or_refused(name: str, tmp_path: Path) -> None:
    assert read_mutations(name, tmp_path, range(1000, 2000)) > 100

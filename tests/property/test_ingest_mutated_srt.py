"""Whatever happens to a subtitle file on its way: samples or one line, never a traceback, never a long wait."""

import time
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.ingest.telemetry.dji_srt import read_dji_srt

SEED = 20_261_127
MOST_S = 2.0
DIALECTS = (
    "{n}\n00:00:{s:02d},000 --> 00:00:{s:02d},900\n<font size=\"28\">FrameCnt: {n}, DiffTime: 33ms\n"
    "2026-06-14 09:30:{s:02d},000,000\n[focal_len: 24.00] [latitude: 58.4017433] [longitude: 15.57{s:02d}] "
    "[rel_alt: 15.384 abs_alt: 128.651] [gb_yaw: 1.0 gb_pitch: -45.0 gb_roll: 0.0] </font>\n\n",
    "{n}\n00:00:{s:02d},000 --> 00:00:{s:02d},900\nSS 60, RTK (15.57{s:02d}, 58.401743, 28), D 75.36m, H 76.19m, "
    "H.S 0.30m/s, F.PRY (-5.3°, 2.1°, 28.3°), G.PRY (-40.0°, 0.0°, 28.2°)\n\n",
    "{n}\n00:00:{s:02d},000 --> 00:00:{s:02d},900\nHOME(149.0,-20.2) 2017.08.05 14:11:{s:02d}\n"
    "GPS(149.02{s:02d},-20.2533,16) BAROMETER:1.9\nISO:100 Shutter:60\n\n",
)  # fmt: skip
ENCODINGS = ("utf-8", "utf-16", "latin-1")


def mutated(rng: np.random.Generator) -> bytes:
    text = "".join(DIALECTS[rng.integers(3)].format(n=k + 1, s=k) for k in range(int(rng.integers(1, 20))))
    data = bytearray(text.encode(ENCODINGS[rng.integers(3)]))
    for _ in range(int(rng.integers(1, 9))):
        at = int(rng.integers(len(data)))
        kind = rng.integers(6)
        if kind == 0:
            data[at] = int(rng.integers(256))
        elif kind == 1:
            del data[at : at + int(rng.integers(1, 40))]
        elif kind == 2:
            data[at:at] = data[: int(rng.integers(1, 200))]
        elif kind == 3:
            data[at:at] = b"9" * int(rng.integers(1, 400))
        elif kind == 4:
            del data[at:]
        else:
            data[at:at] = (b"-->", b"\n\n", b"[", b"(((((", b"\xff\xfe", b"nan", b"\0\0")[rng.integers(7)]
        if not data:
            break
    return bytes(data)


def read_all(folder: Path, count: int, first: int) -> tuple[int, int]:
    path, read, refused = folder / "drone.srt", 0, 0
    for number in range(first, first + count):
        path.write_bytes(mutated(np.random.default_rng([SEED, number])))
        started = time.perf_counter()
        try:
            track = read_dji_srt(path)
        except InputError as error:
            refused += str(error).count("\n") == 0
        else:
            assert (np.diff(track.times_s) > 0).all()
            assert not (np.abs(track.latitude_deg) > 90.0).any()
            read += 1
        assert time.perf_counter() - started < MOST_S, number
    return read, refused


def test_a_mutated_file_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    read, refused = read_all(tmp_path, 200, first=0)
    assert read > 50
    assert refused > 0


@pytest.mark.slow
def test_ten_thousand_mutated_files(tmp_path: Path) -> None:
    assert sum(read_all(tmp_path, 10_000, first=1000)) == 10_000

"""Whatever happens to subtitles on their way: a flight or one line, never a traceback, never a long wait."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.trajectory_of import Ground, trajectory_of
from tests.dialects import demo, dji_subtitles, video_text_track
from tests.mutations import Longest

SEED = 20_261_127
MOST_S = 2.0
FRAME = LocalFrame(58.4, 15.57)
GROUND = Ground("ellipsoid", lambda east, north: 100.0)
TEXTS = (
    dji_subtitles.brackets,
    dji_subtitles.pitch_roll_yaw,
    dji_subtitles.rtk,
    dji_subtitles.barometer,
    dji_subtitles.whole_metres,
    lambda rows, i: (
        f"GPS({rows.latitude_deg[i]:.6f},{rows.longitude_deg[i]:.6f},69.8) BAROMETER(91.2) HOME(1,2)"
    ),
)
ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-be", "latin-1")
SCRAPS = (
    *(
        b"-->",
        b"\n\n",
        b"[",
        b"(((((",
        b"\xff\xfe",
        b"nan",
        b"\0\0",
        b"[latitude: ",
        b"GPS(",
        b"inf",
        b"1e999",
    ),
    *(
        b"-",
        b"\r",
        b"00:00:00,000 --> 00:00:00,033\n",
        b"99999999:99:99,999",
        b"0000-00-00 00:00:00",
        b"\xe2\x80\xae",
    ),
)
FLIGHT = demo.at_rate(demo.true_track("drone-1"), 2.0)


def mutated(data: bytearray, rng: np.random.Generator) -> bytes:
    """One to eight damages anywhere: bytes changed, lost, repeated, moved, cut off; scraps and long numbers put in."""
    for _ in range(int(rng.integers(1, 9))):
        if not data:
            break
        at, size = int(rng.integers(len(data))), int(rng.integers(1, 200))
        match int(rng.integers(8)):
            case 0:
                data[at] = int(rng.integers(256))
            case 1:
                del data[at : at + size]
            case 2:
                data[at:at] = data[:size]
            case 3:
                data[at:at] = b"9" * (2 * size)
            case 4:
                del data[at:]
            case 5:
                taken = bytes(data[at : at + size])
                del data[at : at + size]
                data += taken
            case 6:
                data[at : at + size] = bytes(rng.integers(0, 256, size, dtype=np.uint8))
            case _:
                data[at:at] = SCRAPS[rng.integers(len(SCRAPS))]
    return bytes(data)


def a_file(path: Path, rng: np.random.Generator) -> None:
    rows = demo.at_rate(FLIGHT, float(rng.choice([0.2, 0.5, 1.0])))
    line_end = str(rng.choice(["\n", "\r\n", "\r"]))
    dji_subtitles.write(
        path, rows, TEXTS[rng.integers(len(TEXTS))], ENCODINGS[rng.integers(len(ENCODINGS))], line_end
    )


def outcome(path: Path) -> str:
    """``read`` or ``refused``; what is read is possible."""
    telemetry = Telemetry.model_validate(
        {"file": path, "height": "relative", "gimbal": {"pitch": {"degrees": -45}, "yaw": "course"}}
    )
    try:
        track = read_telemetry(telemetry)
        assert (np.diff(track.times_s) > 0).all()
        assert not (np.abs(track.latitude_deg) > 90.0).any()
        trajectory = trajectory_of(track, telemetry, FRAME, GROUND)
        for time_s in (0.0, 1.5, 20.0, 1e6):
            pose = trajectory.pose(time_s)
            assert pose is None or np.isfinite(pose.position_enu).all()
    except InputError as error:
        return "refused" if str(error).count("\n") == 0 else "more than a line"
    return "read"


def outcomes(folder: Path, count: int, first: int) -> Counter[str]:
    path, seen, longest = folder / "drone.srt", Counter[str](), Longest(MOST_S)
    for number in range(first, first + count):
        rng = np.random.default_rng([SEED, number])
        a_file(path, rng)
        path.write_bytes(mutated(bytearray(path.read_bytes()), rng))
        try:
            with longest.of(number):
                seen[outcome(path)] += 1
        except Exception as error:
            raise AssertionError(f"file {number}: {error!r}") from error
    print(dict(seen), f"longest {longest.seconds:.2f} s")
    return seen


def test_a_mutated_file_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    seen = outcomes(tmp_path, 200, first=0)
    assert seen["read"] > 100
    assert seen["refused"] > 0
    assert set(seen) == {"read", "refused"}


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_ten_thousand_mutated_files(tmp_path: Path) -> None:
    seen = outcomes(tmp_path, 10_000, first=1000)
    assert seen["read"] + seen["refused"] == 10_000


def test_a_mutated_text_track_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    whole = tmp_path / "whole.mp4"
    video_text_track.write(whole, demo.DEMO / "drone-1.mp4", FLIGHT, dji_subtitles.brackets)
    data, path = whole.read_bytes(), tmp_path / "drone.mp4"
    moov = data.rindex(b"moov")
    for number in range(40):
        rng = np.random.default_rng([SEED, 1, number])
        # the index, where a wrong byte does the most harm
        path.write_bytes(data[:moov] + mutated(bytearray(data[moov:]), rng))
        assert outcome(path) in ("read", "refused")

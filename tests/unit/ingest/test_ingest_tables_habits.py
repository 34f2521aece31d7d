"""Tables of other habits: headings that go on, radians that nobody names, months in words, cells that spaces part."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.tables.dates import moment
from pipeline.ingest.track import Track

COLUMNS = {
    "time": {"name": "t", "unit": "seconds"},
    "latitude": {"name": "lat"},
    "longitude": {"name": "lon"},
    "absolute_height": {"name": "h", "unit": "m"},
    "yaw": {"name": "yaw"},
    "pitch": {"name": "pitch"},
    "roll": {"name": "roll"},
}
Row = Callable[[int], list[object]]


def read(
    folder: Path, row: Row, columns: dict[str, object] | None = None, delimiter: str = ",", n: int = 40
) -> Track:
    head = ["t", "lat", "lon", "h", "yaw", "pitch", "roll"]
    path = folder / "flight.csv"
    lines = [delimiter.join(map(str, cells)) for cells in (head, *map(row, range(n)))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_telemetry(Telemetry.model_validate({"file": path, "columns": COLUMNS | (columns or {})}))


def angles(yaw: Callable[[int], object], pitch: object, roll: object = 0.1) -> Row:
    return lambda i: [0.1 * i, 58.4 + 1e-6 * i, 15.5, 128.6, yaw(i), pitch, roll]


@pytest.mark.parametrize("start", [350.5, -715.5, 715.5, 350])
def test_a_heading_that_goes_on_beyond_a_turn_leaves_the_pitch_as_it_is(tmp_path: Path, start: float) -> None:
    track = read(tmp_path, angles(lambda i: start + i * np.sign(start), -45, 0))
    assert np.degrees(track.pitch_rad) == pytest.approx(-45.0)
    turned = np.degrees(track.yaw_rad) - (start + np.sign(start) * np.arange(40))
    assert np.mod(turned + 180.0, 360.0) == pytest.approx(180.0)
    assert "full turns are taken off" in track.assumed[0]


@pytest.mark.parametrize(("yaw", "pitch"), [(905, -455), (305, -455), (3305, -55), (-1750, -899)])
def test_whole_numbers_that_no_degrees_can_be_are_tenths(tmp_path: Path, yaw: int, pitch: int) -> None:
    track = read(tmp_path, angles(lambda i: yaw, pitch, 0))
    assert np.degrees([track.yaw_rad[0], track.pitch_rad[0]]) == pytest.approx([yaw / 10, pitch / 10])
    assert "tenths of a degree" in track.assumed[0]


@pytest.mark.parametrize(("yaw", "pitch"), [(1.57, -0.785), (-3.1, -1.2), (6.2, 0.4)])
def test_angles_that_look_like_radians_are_asked_about(tmp_path: Path, yaw: float, pitch: float) -> None:
    row = angles(lambda i: yaw, pitch)
    with pytest.raises(InputError, match=r"pitch.unit: found no unit .* expected radians or degrees"):
        read(tmp_path, row)
    stated = {name: {"name": name, "unit": "radians"} for name in ("yaw", "pitch", "roll")}
    assert read(tmp_path, row, stated).pitch_rad == pytest.approx(pitch)
    level = {name: {"name": name, "unit": "degrees"} for name in ("yaw", "pitch", "roll")}
    assert np.degrees(read(tmp_path, row, level).pitch_rad) == pytest.approx(pitch)


@pytest.mark.parametrize(("yaw", "pitch"), [(90.0, -1.2), (3.0, -45.0), (3.0, 0.0)])
def test_degrees_that_cannot_be_radians_are_not_asked_about(tmp_path: Path, yaw: float, pitch: float) -> None:
    assert np.degrees(read(tmp_path, angles(lambda i: yaw, pitch)).yaw_rad) == pytest.approx(yaw)


def test_a_column_may_be_scaled_for_a_pitch_that_is_positive_downward(tmp_path: Path) -> None:
    row = angles(lambda i: 90.0, 45.0)
    track = read(tmp_path, row, {"pitch": {"name": "pitch", "scale": -1}})
    assert np.degrees(track.pitch_rad) == pytest.approx(-45.0)
    assert np.degrees(track.yaw_rad) == pytest.approx(90.0)


@pytest.mark.parametrize("delimiter", [" ", "   ", "\t", "|", ";"])
def test_cells_may_be_parted_by_anything_where_the_mission_names_the_columns(
    tmp_path: Path, delimiter: str
) -> None:
    track = read(tmp_path, angles(lambda i: 90.0, -45.0), delimiter=delimiter)
    assert (len(track.times_s), track.longitude_deg[0]) == (40, 15.5)


@pytest.mark.parametrize(
    ("text", "iso"),
    [
        ("14 Jun 2026 09:30:01", "2026-06-14T09:30:01"),
        ("14-Jun-26 09:30:01.5", "2026-06-14T09:30:01.5"),
        ("Jun 14, 2026 9:30:01 AM", "2026-06-14T09:30:01"),
        ("Sun, 14 Jun 2026 09:30:01 +0000", "2026-06-14T09:30:01"),
        ("14 September 2026 21:30", "2026-09-14T21:30"),
    ],
)
def test_months_may_be_words(text: str, iso: str) -> None:
    read_ = moment(text, False)
    assert read_ is not None
    assert read_.day_ns is not None
    assert read_.of_day_ns is not None
    assert read_.day_ns + read_.of_day_ns == int(np.datetime64(iso, "ns").astype(np.int64))


@pytest.mark.parametrize("text", ["31 Feb 2026 09:30:01", "14 Foo 2026 09:30:01", "Jun 2026"])
def test_what_is_no_date_is_none(text: str) -> None:
    assert moment(text, False) is None


def test_minutes_with_fractions_of_seconds_are_times_of_flight(tmp_path: Path) -> None:
    track = read(
        tmp_path,
        lambda i: [f"12:{30 + i}.5", 58.4, 15.5, 128.6, 90.0, -45.0, 0.0],
        {"time": {"name": "t"}},
        n=9,
    )
    assert np.diff(track.times_s) == pytest.approx(1.0)
    assert track.times_s[0] == pytest.approx(750.5)


@pytest.mark.parametrize(
    ("latitude", "longitude", "hint"),
    [(584_017_430, 155_748_150, "degE7"), (6_474_000.5, 533_600.2, "UTM"), (115.5, 58.4, "exchanged")],
)
def test_positions_that_are_no_degrees_say_what_they_may_be(
    tmp_path: Path, latitude: float, longitude: float, hint: str
) -> None:
    with pytest.raises(InputError, match=hint):
        read(tmp_path, lambda i: [0.1 * i, latitude, longitude, 128.6, 90.0, -45.0, 0.0])

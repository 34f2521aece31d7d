"""Tables in the ways that people write them: layout, numbers, dates, clocks."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pipeline.config.telemetry import COLUMN_QUANTITIES, Column, Table, Telemetry
from pipeline.errors import InputError
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.tables.cells import degrees, flags, nmea_degrees, number
from pipeline.ingest.tables.dates import is_month_first, moment
from pipeline.ingest.tables.units import factor, is_unit, split_unit
from pipeline.ingest.track import Track

START_NS = 1_781_429_400_000_000_000  # 2026-06-14 09:30:00 UTC
GPS_WEEK, GPS_S = 2423, 34_200 + 18  # that Sunday, in GPS time
PLAIN = {"latitude": {"name": "lat"}, "longitude": {"name": "lon"}}


def read(path: Path, text: str | bytes, columns: dict[str, Any], **layout: Any) -> Track:
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    spelt = {name: Column(**kept) for name, kept in columns.items()}
    return read_telemetry(Telemetry(file=path, format="table", columns=spelt, table=Table(**layout)))


NUMBERED = {
    "time": {"name": 1, "unit": "s"},
    "latitude": {"name": 2},
    "longitude": {"name": 3},
    "absolute_height": {"name": 4},
}
#: text, the map of its columns, how the mission says it is laid out
LAYOUTS: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    "commas": ("t,lat,lon,alt\n0.0,58.4,15.5,100\n0.1,58.4,15.5,100\n", {}, {}),
    "tabs": ("t\tlat\tlon\talt\n0.0\t58.4\t15.5\t100\n0.1\t58.4\t15.5\t100\n", {}, {}),
    "bars and spaces": ("t | lat | lon | alt\n0.0 | 58.4 | 15.5 | 100\n0.1 | 58.4 | 15.5 | 100\n", {}, {}),
    "semicolons, decimal commas": ("t;lat;lon;alt\n0,0;58,4;15,5;100,0\n0,1;58,4;15,5;100,0\n", {}, {}),
    "quoted decimal commas": ('t,lat,lon,alt\n"0,0","58,4","15,5",100\n"0,1","58,4","15,5",100\n', {}, {}),
    "thousands": ("t;lat;lon;alt\n0,0;58,4;15,5;1.00,0\n0,1;58,4;15,5;1.00,0\n", {}, {}),
    "sep=": ("sep=;\nt;lat;lon;alt\n0.0;58.4;15.5;100\n0.1;58.4;15.5;100\n", {}, {}),
    "a title, notes, a line of units": (
        "Flight 17\n# by hand\n\nt,lat,lon,alt\ns,deg,deg,ft\n0.0,58.4,15.5,328.084\n0.1,58.4,15.5,328.084\n",
        {"time": {"name": "t (s)"}, "latitude": {"name": "lat (deg)"}, "longitude": {"name": "lon (deg)"},
         "absolute_height": {"name": "alt (ft)"}},
        {},
    ),
    "groups over the names": (
        ",GPS,GPS,GPS\nt,lat,lon,alt\n0.0,58.4,15.5,100\n0.1,58.4,15.5,100\n", {}, {},
    ),
    "spaces, comments": (
        "% program: RTKLIB\n% t lat lon alt\n t  lat   lon   alt\n 0.0  58.4  15.5  100\n 0.1  58.4  15.5  100\n",
        {}, {},
    ),
    "no head": (
        "0.0,58.4,15.5,100\n0.1,58.4,15.5,100\n",
        NUMBERED,
        {},
    ),
    "a head of numbers, stated": ("1,2,3,4\n0.0,58.4,15.5,100\n0.1,58.4,15.5,100\n",
        NUMBERED,
        {"head_lines": 1},
    ),
    "a stated delimiter": ("t:lat:lon:alt\n0.0:58.4:15.5:100\n0.1:58.4:15.5:100\n", {}, {"delimiter": ":"}),
    "line ends in quotes": (
        't,note,lat,lon,alt\n0.0,"two\nlines, ""quoted""",58.4,15.5,100\n0.1,,58.4,15.5,100\n', {}, {},
    ),
    "units behind the numbers": ("t,lat,lon,alt\n0.0 s,58.4,15.5,328.084 ft\n0.1 s,58.4,15.5,328.084 ft\n", {}, {}),
    "degrees, minutes, seconds": ("t,lat,lon,alt\n0.0,58°24'00.0\"N,E 15 30 0,100\n0.1,N58 24.0,15°30'E,100\n", {}, {}),
    "degrees times ten millions": (
        "t,lat,lon,alt\n0.0,584000000,155000000,100000\n0.1,584000000,155000000,100000\n",
        {"latitude": {"name": "lat", "unit": "degE7"}, "longitude": {"name": "lon", "unit": "degE7"},
         "absolute_height": {"name": "alt", "unit": "mm"}},
        {},
    ),
    "NMEA": (
        "t,lat,lon,alt\n0.0,5824.0000N,01530.0000E,100\n0.1,5824.0000N,01530.0000E,100\n",
        {"latitude": {"name": "lat", "unit": "nmea"}, "longitude": {"name": "lon", "unit": "nmea"}},
        {},
    ),
    "radians": (
        f"t,lat,lon,alt\n0.0,{math.radians(58.4)},{math.radians(15.5)},100\n0.1,{math.radians(58.4)},{math.radians(15.5)},100\n",
        {"latitude": {"name": "lat", "unit": "radians"}, "longitude": {"name": "lon", "unit": "radians"}},
        {},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_layout_gives_the_same_two_samples(tmp_path: Path, name: str) -> None:
    text, columns, layout = LAYOUTS[name]
    usual = {"time": {"name": "t", "unit": "seconds"}, **PLAIN, "absolute_height": {"name": "alt"}}
    track = read(tmp_path / "own.csv", text, usual | columns, **layout)
    assert track.times_s.tolist() == [0.0, 0.1]
    assert np.allclose(track.latitude_deg, 58.4, atol=1e-9)
    assert np.allclose(track.longitude_deg, 15.5, atol=1e-9)
    assert np.allclose(track.absolute_height_m, 100.0, atol=1e-3)
    assert (track.clock, track.tied_to_video, dict(track.left_out)) == ("unknown", False, {})


#: cells of the first and a second row that is half a second later, what the mission says of the column
TIMES: dict[str, tuple[str, str, dict[str, Any]]] = {
    "ISO with Z": ("2026-06-14T09:30:00Z", "2026-06-14T09:30:00.5Z", {}),
    "ISO with an offset": ("2026-06-14T11:30:00.000+02:00", "2026-06-14T11:30:00.500+0200", {}),
    "ISO, zone stated": ("2026-06-14 05:30:00", "2026-06-14 05:30:00.500", {"zone": "-04:00"}),
    "compact": ("20260614T093000Z", "20260614T093000.5Z", {}),
    "EXIF": ("2026:06:14 09:30:00", "2026:06:14 09:30:00.50", {"zone": "utc"}),
    "German": ("14.06.2026 09:30:00,0", "14.06.2026 09:30:00,5", {"zone": "utc"}),
    "American": ("6/14/2026 9:30:00.0 AM", "6/14/2026 9:30:00.5 AM", {"zone": "utc"}),
    "British": ("14/06/2026 09:30:00", "14/06/2026 09:30:00.5", {"zone": "utc"}),
    "a pattern": ("14-Jun-26 09h30m00.0", "14-Jun-26 09h30m00.5", {"unit": "%d-%b-%y %Hh%Mm%S.%f", "zone": "utc"}),
    "epoch, s": ("1781429400.0", "1781429400.5", {}),
    "epoch, ms": ("1781429400000", "1781429400500", {}),
    "epoch, us": ("1781429400000000", "1781429400500000", {}),
    "epoch, ns": ("1781429400000000000", "1781429400500000000", {}),
    "epoch, ms, stated": ("1781429400000", "1781429400500", {"unit": "ms"}),
    "GPS seconds": (str(GPS_WEEK * 604_800 + GPS_S), f"{GPS_WEEK * 604_800 + GPS_S}.5", {"unit": "gps"}),
    "days of a spreadsheet": ("46187.395833333336", "46187.395839120371", {"unit": "excel"}),
}  # fmt: skip


@pytest.mark.parametrize("name", TIMES)
def test_every_way_to_write_a_date_is_that_date(tmp_path: Path, name: str) -> None:
    first, second, said = TIMES[name]
    text = f"when;lat;lon\n{first};58.4;15.5\n{second};58.4;15.5\n"
    track = read(tmp_path / "own.csv", text, {"time": {"name": "when", **said}, **PLAIN}, delimiter=";")
    assert track.clock == "utc"
    assert track.start_time_ns == pytest.approx(START_NS, abs=5_000)
    assert track.times_s[1] - track.times_s[0] == pytest.approx(0.5, abs=2e-6)


def test_a_gps_week_with_its_seconds_is_a_date(tmp_path: Path) -> None:
    text = f"week,tow,lat,lon\n{GPS_WEEK},{GPS_S}.000,58.4,15.5\n{GPS_WEEK},{GPS_S}.200,58.4,15.5\n"
    columns = {"gps_week": {"name": "week"}, "time": {"name": "tow", "unit": "s"}, **PLAIN}
    track = read(tmp_path / "own.csv", text, columns)
    assert (track.start_time_ns, track.clock) == (START_NS, "utc")
    assert any("18 s ahead" in sentence for sentence in track.assumed)


def test_a_date_may_stand_apart_from_the_time_and_go_on_over_midnight(tmp_path: Path) -> None:
    text = "d,t,lat,lon\n2026-06-13,23:59:59.5,58.4,15.5\n2026-06-14,00:00:00.5,58.4,15.5\n"
    columns = {"date": {"name": "d"}, "time": {"name": "t", "zone": "utc"}, **PLAIN}
    assert read(tmp_path / "own.csv", text, columns).times_s.tolist() == [0.0, 1.0]
    del columns["date"]
    track = read(tmp_path / "own.csv", text, columns)
    assert np.diff(track.times_s).tolist() == [1.0]
    assert (track.clock, track.start_time_ns) == ("unknown", 0)


def test_a_date_that_may_have_the_day_first_is_said(tmp_path: Path) -> None:
    text = "t,lat,lon\n3/4/2026 09:30:00,58.4,15.5\n3/4/2026 09:30:01,58.4,15.5\n"
    track = read(tmp_path / "own.csv", text, {"time": {"name": "t", "zone": "utc"}, **PLAIN})
    assert any("has the month first" in sentence for sentence in track.assumed)


def test_times_without_a_unit_are_asked_about(tmp_path: Path) -> None:
    text = "t,lat,lon\n100,58.4,15.5\n200,58.4,15.5\n"
    with pytest.raises(
        InputError, match=r"time\.unit: found no unit for times from 100 to 200; expected one of seconds"
    ):
        read(tmp_path / "own.csv", text, {"time": {"name": "t"}, **PLAIN})
    with pytest.raises(InputError, match=r"time\.unit: found 'fortnights'"):
        read(tmp_path / "own.csv", text, {"time": {"name": "t", "unit": "fortnights"}, **PLAIN})


def test_a_table_of_angles_alone_is_read_without_positions(tmp_path: Path) -> None:
    text = "t,pan,tilt\n2026-06-14T09:30:00Z,10,-45\n2026-06-14T09:30:01Z,11,\n2026-06-14T09:30:02Z,12,-46\n"
    columns = {"time": {"name": "t"}, "yaw": {"name": "pan"}, "pitch": {"name": "tilt"}}
    track = read(tmp_path / "gimbal.csv", text, columns)
    assert np.degrees(track.pitch_rad).round(6).tolist() == [-45.0, -46.0]
    assert (np.isnan(track.latitude_deg).all(), track.left_out) == (True, {"incomplete": 1})
    with pytest.raises(InputError, match="found no latitude"):
        read(tmp_path / "gimbal.csv", text, {"time": {"name": "t"}})


def test_times_that_count_from_the_videos_first_picture_are_tied_to_it(tmp_path: Path) -> None:
    text = "t,lat,lon\n0,58.4,15.5\n200,58.4,15.5\n"
    columns = {"time": {"name": "t", "unit": "ms", "zone": "video"}, **PLAIN}
    track = read(tmp_path / "own.csv", text, columns)
    assert track.tied_to_video
    assert track.times_s.tolist() == [0.0, 0.2]


def test_rows_that_share_a_whole_second_are_spread_over_it(tmp_path: Path) -> None:
    rows = [f"2026-06-14 09:30:{k // 5:02d},58.4,15.5" for k in range(3, 20)]
    track = read(
        tmp_path / "own.csv", "t,lat,lon\n" + "\n".join(rows), {"time": {"name": "t", "zone": "utc"}, **PLAIN}
    )
    assert np.allclose(np.diff(track.times_s), 0.2)
    assert track.start_time_ns == START_NS + 600_000_000
    assert any("spread evenly" in sentence for sentence in track.assumed)


def test_a_few_times_far_ahead_do_not_cost_all_that_follow(tmp_path: Path) -> None:
    times = [0.0, 0.1, 900.1, 900.2, 900.3, *(0.2 + 0.1 * k for k in range(20))]
    rows = "\n".join(f"{t:.1f},58.4,15.5" for t in times)
    track = read(tmp_path / "own.csv", "t,lat,lon\n" + rows, {"time": {"name": "t", "unit": "s"}, **PLAIN})
    assert len(track.times_s) == 22
    assert track.left_out == {"out_of_order": 3}
    assert track.first_left_out["out_of_order"].endswith("own.csv:4")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no row of samples"),
        ("t,lat,lon\n", "no row of samples"),
        ("t,lat,lon\n0,58,4,15,5\n1,58,4,15,5\n", "rows of more cells than the 3 of the head, split at ','"),
        ("t,lat,lon\nx,58.4,15.5\ny,58.4,15.5\n", "no time in any row"),
    ],
)
def test_a_table_that_cannot_be_used_is_one_line_with_the_reason(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path / "own.csv", text, {"time": {"name": "t", "unit": "s"}, **PLAIN}, head_lines=1)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "decimal", "value"),
    [("1.5", ".", 1.5), ("1,5", ",", 1.5), ("1.234,5", ",", 1234.5), ("-1e-3", ".", -0.001), ("−7", ".", -7.0),
     ("12.5 m", ".", math.nan), ("1_0", ".", math.nan), ("inf", ".", math.nan), ("1e999", ".", math.nan),
     ("", ".", math.nan)],
)  # fmt: skip
def test_numbers(text: str, decimal: str, value: float) -> None:
    assert number(text, decimal) == pytest.approx(value, nan_ok=True)


def test_positions_in_words() -> None:
    assert degrees("58°24'06.3\"N") == pytest.approx(58.40175)
    assert degrees("58 24 06.3 S") == pytest.approx(-58.40175)
    assert degrees("W15,5°") == -15.5
    assert degrees("15.5749E") == 15.5749
    assert math.isnan(degrees("58 75 00 N"))
    assert nmea_degrees("5824.105,S".replace(",", " ")) == pytest.approx(-58.40175)
    assert math.isnan(nmea_degrees("5875.0N"))


def test_flags_units_and_dates() -> None:
    assert flags(["1", "True", "Recording", "0", "no", ""]).tolist() == [1, 1, 1, 0, 0, 0]
    assert math.isnan(flags(["perhaps"])[0])
    assert split_unit("height_above_takeoff(feet)") == ("height_above_takeoff", "feet")
    assert split_unit("OSD.height [ft]") == ("OSD.height", "ft")
    assert split_unit("alt_m") == ("alt", "m")
    assert split_unit("album") == ("album", "")
    assert (factor("Feet", "length"), factor("mrad", "length"), is_unit("[m]"), is_unit("lat")) == (
        0.3048,
        None,
        True,
        False,
    )
    assert is_month_first(["6/14/2026", "6/15/2026"]) == (True, False)
    assert is_month_first(["14/6/2026"]) == (False, False)
    assert is_month_first(["3/4/2026"]) == (True, True)
    assert moment("2026-02-30 10:00:00", month_first=False) is None
    assert moment("25:00:00", month_first=False) is None


def test_the_example_of_the_documentation_is_a_valid_section() -> None:
    page = (Path(__file__).parents[3] / "docs/telemetry.md").read_text(encoding="utf-8")
    example = page.split("### A table of one's own\n\n")[1].split("\n\nWithout")[0]
    telemetry = Telemetry(**yaml.safe_load(textwrap.dedent(example))["telemetry"])
    assert telemetry.columns["roll"].name == 7
    for quantity in COLUMN_QUANTITIES:
        assert f"`{quantity}`" in page, quantity

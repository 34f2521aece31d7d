"""The report: one HTML file with everything in it, readable offline, on a phone, by day and by night."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from pipeline.fusion.one_person import expected_people
from pipeline.fusion.salient import SalientLocation
from pipeline.fusion.voxel_map import VoxelMap
from pipeline.geo.grids import mgrs_of
from pipeline.messages import FloatArray
from pipeline.outputs.html import page_environment
from pipeline.outputs.local_times import LocalTimes
from pipeline.outputs.map_picture import map_picture, observed_area_m2, png
from pipeline.outputs.place_picture import PlacePicture, minutes_seconds
from pipeline.outputs.summary import Summary
from pipeline.outputs.truth import TruePerson
from pipeline.second_look.areas import SecondLookArea
from pipeline.second_look.flight import SecondFlight
from pipeline.storage.whole_or_nothing import write_text

#: of the columns of the table of substreams
_HOPS = {
    "encode": "Encode",
    "transfer": "Transfer",
    "decode": "Decode",
    "detect": "Detect",
    "own": "Waiting",
    "hold": "Order",
    "capture_to_map": "Capture to map",
}


@dataclass(frozen=True, eq=False)
class ReportData:
    """What the report shows.

    tracks: positions of each drone, stream -> float64 (N, >=2), ENU metres. truth: empty if not known.
    schedule: the Gantt picture of the plan. pictures: of the found and the possible places. second_look: areas worth
    one, the most worth first. second_flight: over them; its picture. time_zone: of the times shown, see ``LocalTimes``.
    """

    summary: Summary
    voxel_map: VoxelMap
    tracks: Mapping[str, FloatArray]
    truth: Sequence[TruePerson]
    schedule: Figure
    pictures: Sequence[PlacePicture] = ()
    second_look: Sequence[SecondLookArea] = ()
    second_flight: SecondFlight | None = None
    second_picture: Figure | None = None
    time_zone: str | None = None


def write_report(path: Path, data: ReportData) -> None:
    """Write the report as one self-contained HTML file."""
    write_text(path, render_report(data))


def render_report(data: ReportData) -> str:
    """The report's HTML; every text from outside is escaped."""
    summary = data.summary
    environment = page_environment("pipeline.outputs")
    times = LocalTimes(summary.clock, data.time_zone)
    environment.filters.update(
        local=times,
        of_day=times.of_day,
        in_video=_in_video,
        mgrs=_mgrs,
        geo=_geo_uri,
        rate=_rate,
        milliseconds=_milliseconds,
        percent=_percent,
    )
    places = _by_probability(summary.locations)
    possible = _by_probability(summary.possible)
    listed = [*places, *possible]
    first_ns = min((place.first_seen_ns for place in listed), default=None)
    shown: dict[int, list[PlacePicture]] = {}
    for picture in data.pictures:
        shown.setdefault(picture.place, []).append(picture)
    accounts = [*summary.streams, *(account for flight in summary.earlier for account in flight.streams)]
    return environment.get_template("report.html.j2").render(
        summary=summary,
        places=places,
        expected=expected_people(places),
        possible=possible,
        shown=shown,
        zone_said="" if first_ns is None else times.said(first_ns),
        verdict=summary.verdict,
        distance_m={} if summary.match is None else summary.match.distance_m,
        area_ha=observed_area_m2(data.voxel_map) / 1e4,
        captured=sum(account.captured for account in accounts),
        processed=sum(account.processed for account in accounts),
        map_png=png(map_picture(data.voxel_map, data.tracks, places, data.truth, possible)),
        schedule_png=png(data.schedule),
        hops=[
            (name, title) for name, title in _HOPS.items() if any(name in s.hops for s in summary.substreams)
        ],
        second_look=data.second_look,
        second_flight=data.second_flight,
        second_png=None if data.second_picture is None else png(data.second_picture),
    )


def _by_probability(places: Sequence[SalientLocation]) -> list[SalientLocation]:
    """The most probable first: the order in which they are looked at."""
    return sorted(places, key=lambda place: (-place.probability, place.id))


def _mgrs(place: SalientLocation) -> str:
    return mgrs_of(place.latitude_deg, place.longitude_deg)


def _in_video(picture: PlacePicture) -> str:
    """Stream, file, position and number of the picture, as far as they are known."""
    at = picture.at
    if at is None:
        return picture.stream
    if at.time_s is None:
        return f"{picture.stream}, {at.name}"
    return f"{picture.stream}, {at.name} at {minutes_seconds(at.time_s)}, frame {at.frame}"


def _geo_uri(place: SalientLocation) -> str:
    """RFC 5870: phones open their map on it, offline too."""
    return f"geo:{place.latitude_deg:.7f},{place.longitude_deg:.7f}"


def _rate(bps: float) -> str:
    if bps == float("inf"):
        return "no limit"
    return f"{bps / 1e6:.2f} Mbps" if bps >= 1e6 else f"{bps / 1e3:.0f} kbps"


def _milliseconds(seconds: float | None) -> str:
    return "–" if seconds is None else f"{1e3 * seconds:.1f}"


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{share:.0%}"

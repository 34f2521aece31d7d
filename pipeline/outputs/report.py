"""The report: one HTML file with everything in it, readable offline, on a phone, by day and by night."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from pipeline.fusion.one_person import expected_people
from pipeline.fusion.salient import SalientLocation
from pipeline.fusion.voxel_map import VoxelMap
from pipeline.messages import FloatArray
from pipeline.outputs.html import page_environment
from pipeline.outputs.map_picture import map_picture, observed_area_m2, png
from pipeline.outputs.summary import Summary
from pipeline.outputs.times import clock_time, iso_time, zone_name
from pipeline.outputs.truth import TruePerson
from pipeline.second_look.areas import SecondLookArea
from pipeline.second_look.flight import SecondFlight
from pipeline.storage.whole_or_nothing import write_text


@dataclass(frozen=True, eq=False)
class ReportData:
    """What the report shows.

    tracks: positions of each drone, stream -> float64 (N, >=2), ENU metres. truth: empty if not known.
    schedule: the Gantt picture of the plan. crops: (id of the found or possible place, PNG of what was seen there).
    second_look: areas worth one, the most worth first. second_flight: over them; its picture.
    """

    summary: Summary
    voxel_map: VoxelMap
    tracks: Mapping[str, FloatArray]
    truth: Sequence[TruePerson]
    schedule: Figure
    crops: Sequence[tuple[int, bytes]] = ()
    second_look: Sequence[SecondLookArea] = ()
    second_flight: SecondFlight | None = None
    second_picture: Figure | None = None


def write_report(path: Path, data: ReportData) -> None:
    """Write the report as one self-contained HTML file."""
    write_text(path, render_report(data))


def render_report(data: ReportData) -> str:
    """The report's HTML; every text from outside is escaped."""
    summary = data.summary
    environment = page_environment("pipeline.outputs")
    environment.filters.update(
        iso=iso_time,
        clock=clock_time,
        geo=_geo_uri,
        rate=_rate,
        milliseconds=_milliseconds,
        percent=_percent,
    )
    places = summary.locations
    listed = [*places, *summary.possible]
    accounts = [*summary.streams, *(account for flight in summary.earlier for account in flight.streams)]
    return environment.get_template("report.html.j2").render(
        summary=summary,
        places=places,
        expected=expected_people(places),
        named={place.id for place in places},
        zone=zone_name(summary.clock),
        verdict=summary.verdict,
        distance_m={} if summary.match is None else summary.match.distance_m,
        first_ns=min((place.first_seen_ns for place in listed), default=None),
        area_ha=observed_area_m2(data.voxel_map) / 1e4,
        captured=sum(account.captured for account in accounts),
        processed=sum(account.processed for account in accounts),
        map_png=png(map_picture(data.voxel_map, data.tracks, places, data.truth, summary.possible)),
        schedule_png=png(data.schedule),
        crops=data.crops,
        second_look=data.second_look,
        second_flight=data.second_flight,
        second_png=None if data.second_picture is None else png(data.second_picture),
    )


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

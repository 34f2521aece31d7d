"""What a run found, on the terminal."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from pipeline.outputs.summary import Summary
from pipeline.outputs.times import clock_time, zone_name


def print_people(summary: Summary) -> None:
    """The verdict, and a row for each place, on standard output."""
    caption = f"±: 95 %; {zone_name(summary.clock)}"
    # without rules between columns it fits 80 characters, and no coordinate is cut
    table = Table(
        pad_edge=False, caption=caption, caption_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0)
    )
    possible = {place.id for place in summary.possible}
    distance = {} if summary.match is None else summary.match.distance_m
    for column in ("no.", "prob.", "latitude", "longitude", "±", "last seen", "looks", "off by"):
        table.add_column(column, justify="right", no_wrap=True)
    for place in (*summary.locations, *summary.possible):
        known = (
            "possible"
            if place.id in possible
            else f"{distance[place.id]:.2f} m"
            if place.id in distance
            else ""
            if summary.match is None
            else "false"
        )
        table.add_row(
            str(place.id),
            f"{place.probability:.2f}",
            f"{place.latitude_deg:.6f}",
            f"{place.longitude_deg:.6f}",
            f"{place.error.semi_major_m:.2f} m",
            clock_time(place.last_seen_ns),
            str(place.looks),
            known,
        )
    console = Console()
    console.print(summary.verdict.sentence, highlight=False, markup=False)
    if table.row_count:
        console.print(table)

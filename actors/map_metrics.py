"""Prometheus metrics of the map."""

from __future__ import annotations

from collections.abc import Iterable

from prometheus_client.core import GaugeMetricFamily, Metric

from actors.reducer import ReducerStatus


def map_metrics(reducer: ReducerStatus | None) -> Iterable[Metric]:
    """Nothing of what is not known: no sample is better than an old one."""
    figures = None if reducer is None else reducer.map
    if figures is not None:
        yield GaugeMetricFamily("searchlight_places", "Places found so far", value=figures.places)
        yield GaugeMetricFamily(
            "searchlight_possible_places", "Possible places so far", value=figures.possible
        )
        yield GaugeMetricFamily(
            "searchlight_searched_square_meters", "Ground that was looked at", value=figures.searched_m2
        )
    ages = GaugeMetricFamily(
        "searchlight_map_age_seconds",
        "How long ago the newest frame of a stream was taken that the map knows (in real time)",
        labels=["stream"],
    )
    for stream, seconds in ({} if reducer is None else reducer.ages_s).items():
        ages.add_metric([stream], seconds)
    yield ages

"""A warning where two streams place the same people apart by more than the mission states."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.config.uncertainty import Uncertainty
from pipeline.fusion.disagreement import disagreements
from pipeline.fusion.salient import SalientLocation
from pipeline.ingest.finding import Finding


def check_agreement(places: Sequence[SalientLocation], uncertainty: Uncertainty) -> list[Finding]:
    """One for each two streams."""
    findings = []
    for found in disagreements(places, uncertainty):
        first, second = found.streams
        east, north = found.apart_m
        text = (
            f"what {second} saw lies {abs(east):.1f} m {'east' if east >= 0.0 else 'west'} and {abs(north):.1f} m "
            f"{'north' if north >= 0.0 else 'south'} of what {first} saw, of {found.pairs} people: places may be "
            "listed twice, and be off by more than their ellipses"
        )
        evidence = f"by fusion.uncertainty that is {found.stated_m:.1f} m (one standard deviation)"
        mend = (
            "larger position_bias or attitude_bias in fusion.uncertainty; or a look at the telemetry of both"
        )
        findings.append(
            Finding("warning", "streams_apart", f"streams {first} and {second}", text, evidence, mend)
        )
    return findings

"""What a run did, in numbers: the record behind summary.json and the report's tables."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pipeline.allocation.plan import Plan
from pipeline.fusion.one_person import expected_people
from pipeline.fusion.salient import SalientLocation
from pipeline.ingest.finding import Finding
from pipeline.ingest.track import Clock
from pipeline.outputs.accounting import StreamAccount
from pipeline.outputs.earlier_flight import EarlierFlight, flight_to_json
from pipeline.outputs.partial import Partial, partial_json
from pipeline.outputs.salient_geojson import ellipse_json, map_probability_json, support_json
from pipeline.outputs.timeline import TimelineEntry
from pipeline.outputs.times import iso_time, zone_name
from pipeline.outputs.truth import MATCH_RADIUS_M, TruthMatch
from pipeline.outputs.verdict import Verdict, judge
from pipeline.second_look.coverage import Coverage
from pipeline.storage.versions import stamp
from pipeline.storage.whole_or_nothing import WRITTEN_BY, write_text


@dataclass(frozen=True)
class Latency:
    """Seconds that results spent on one part of their way. median_at_most_s, p99_at_most_s: upper bounds, as far as the
    buckets of a histogram tell; inf: above all of them.
    """

    mean_s: float
    median_at_most_s: float
    p99_at_most_s: float


@dataclass(frozen=True)
class SubstreamCount:
    """One stream on its way to one detector. offered = processed + the sum of dropped (reason -> count).

    Raises ValueError if the sum does not hold. detections: boxes reported in the processed frames.
    """

    stream: str
    detector: str
    machine: str
    site: str
    offered: int
    processed: int
    dropped: Mapping[str, int]
    detections: int
    hops: Mapping[str, Latency] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.offered != self.processed + sum(self.dropped.values()):
            raise ValueError(
                f"substream {self.stream} -> {self.detector}: {self.offered} frames offered, but "
                f"{self.processed} processed and {sum(self.dropped.values())} dropped"
            )


@dataclass(frozen=True)
class LinkUse:
    """What a stream sent to a site. bandwidth_bps may be infinite.

    duration_s: time over which it was sent. least_bps: the lowest rate that was measured, None where none was (only in
    real time). lost_messages: whose connection broke before they were known to be read.
    """

    stream: str
    site: str
    bandwidth_bps: float
    sent_bytes: int
    duration_s: float
    least_bps: float | None = None
    lost_messages: int = 0

    @property
    def mean_bps(self) -> float:
        """Mean rate, bits per second."""
        return 8.0 * self.sent_bytes / self.duration_s if self.duration_s > 0 else 0.0

    @property
    def share(self) -> float | None:
        """Mean rate over bandwidth, 0 to about 1; None where the link has no limit or no bandwidth at all."""
        limited = math.isfinite(self.bandwidth_bps) and self.bandwidth_bps > 0
        return self.mean_bps / self.bandwidth_bps if limited else None


@dataclass(frozen=True)
class Summary:
    """A finished run.

    seconds: wall time of the run. video_seconds: the longest video. pace: ``realtime`` or ``max``.
    match: None where the truth is not known. not_taken: what the map did not take, reason -> count.
    provenance: label -> text, such as versions; never a secret. clock: of the times. findings: of the checks,
    and what was assumed. left_out: samples of telemetry that were not used, stream -> reason -> count.
    own_detections: where detections that were
    not made by this run come from, and what was assumed of them, a sentence each; empty: this run made them. possible:
    places below the threshold that were detected again and again. coverage: of the ground that was to be searched.
    earlier: flights whose map this run has continued. partial: why and where it ended too early; None: it did not.
    time_zone: that people read times in, None: the mission names none.
    timeline: who was lost and came back, and what was changed for it, in real time.
    """

    mission: str
    mission_file: str
    pace: str
    seconds: float
    video_seconds: float
    plan: Plan
    streams: Sequence[StreamAccount]
    substreams: Sequence[SubstreamCount]
    links: Sequence[LinkUse]
    locations: Sequence[SalientLocation]
    match: TruthMatch | None
    not_taken: Mapping[str, int]
    provenance: Mapping[str, str]
    clock: Clock = "utc"
    findings: Sequence[Finding] = ()
    left_out: Mapping[str, Mapping[str, int]] = field(default_factory=dict)

    @property
    def verdict(self) -> Verdict:
        """What all of it means, in one sentence."""
        boxes = sum(substream.detections for substream in self.substreams)
        return judge(
            self.locations,
            self.match,
            self.not_taken,
            boxes,
            self.findings,
            possible=self.possible,
            coverage=self.coverage,
            partial=self.partial,
        )

    own_detections: Sequence[str] = ()
    possible: Sequence[SalientLocation] = ()
    coverage: Coverage | None = None
    earlier: Sequence[EarlierFlight] = ()
    partial: Partial | None = None
    timeline: Sequence[TimelineEntry] = ()
    time_zone: str | None = None


def write_summary(path: Path, summary: Summary) -> None:
    """Write summary.json: strict JSON, None for what is not known and for a bandwidth without limit."""
    text = json.dumps(summary_to_json(summary), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(path, text + "\n")


def summary_to_json(summary: Summary) -> dict[str, Any]:
    """The summary as plain values; nothing but the record's own fields gets in."""
    content = stamp("summary") | {
        "written_by": WRITTEN_BY,
        "mission": summary.mission,
        "mission_file": summary.mission_file,
        "pace": summary.pace,
        "partial": partial_json(summary.partial),
        "seconds": round(summary.seconds, 3),
        "video_seconds": round(summary.video_seconds, 3),
        "plan": _plan(summary.plan),
        "streams": [_account(account) for account in summary.streams],
        "substreams": [_substream(substream) for substream in summary.substreams],
        "links": [_link(link) for link in summary.links],
        "verdict": asdict(summary.verdict),
        "clock": zone_name(summary.clock),
        "time_zone": summary.time_zone,
        "found": [_place(place, summary.clock) for place in summary.locations],
        "expected_people": round(float(expected_people(summary.locations)), 3),
        "possible": [_place(place, summary.clock) for place in summary.possible],
        "coverage": None if summary.coverage is None else _coverage(summary.coverage),
        "truth": None if summary.match is None else _truth(summary.match),
        "findings": [asdict(finding) for finding in summary.findings],
        "telemetry_left_out": {name: dict(counts) for name, counts in summary.left_out.items()},
        "evidence_not_taken": dict(sorted(summary.not_taken.items())),
        "provenance": dict(summary.provenance),
        "own_detections": list(summary.own_detections),
        "timeline": [asdict(entry) for entry in summary.timeline],
        "earlier_flights": [flight_to_json(flight) for flight in summary.earlier],
    }
    plain = _finite(content)
    assert isinstance(plain, dict)
    return plain


def _plan(plan: Plan) -> dict[str, Any]:
    return {
        "status": plan.status,
        "objective": plan.objective,
        "gap": plan.gap,
        "assignments": len(plan.assignments),
    }


def _account(account: StreamAccount) -> dict[str, Any]:
    return {
        "stream": account.stream,
        "captured": account.captured,
        "processed": account.processed,
        "dropped": dict(account.dropped),
    }


def _substream(substream: SubstreamCount) -> dict[str, Any]:
    return {
        "stream": substream.stream,
        "detector": substream.detector,
        "machine": substream.machine,
        "site": substream.site,
        "offered": substream.offered,
        "processed": substream.processed,
        "dropped": dict(substream.dropped),
        "detections": substream.detections,
        "latency": {hop: asdict(seconds) for hop, seconds in substream.hops.items()},
    }


def _link(link: LinkUse) -> dict[str, Any]:
    return {
        "stream": link.stream,
        "site": link.site,
        "bandwidth_bps": link.bandwidth_bps,
        "sent_bytes": link.sent_bytes,
        "mean_bps": round(link.mean_bps, 1),
        "share": None if link.share is None else round(link.share, 4),
        "least_measured_bps": None if link.least_bps is None else round(link.least_bps, 1),
        "lost_messages": link.lost_messages,
    }


def _place(place: SalientLocation, clock: Clock) -> dict[str, Any]:
    return {
        "id": place.id,
        "class": place.class_name,
        "probability": round(float(place.probability), 6),
        **map_probability_json(place),
        "latitude_deg": round(float(place.latitude_deg), 8),
        "longitude_deg": round(float(place.longitude_deg), 8),
        "height_m": round(float(place.height_m), 3),
        "error_ellipse": ellipse_json(place.error),
        "seen_from": iso_time(place.first_seen_ns, clock),
        "seen_to": iso_time(place.last_seen_ns, clock),
        **support_json(place),
    }


def _coverage(coverage: Coverage) -> dict[str, Any]:
    areas = {
        "wanted_m2": coverage.wanted_m2,
        "judged_m2": coverage.judged_m2,
        "not_judged_m2": coverage.not_judged_m2,
        "looked_at_m2": coverage.looked_m2,
        "nobody_looked_m2": coverage.unseen_m2,
        "seen_anywhere_m2": coverage.seen_m2,
    }
    rounded = {name: round(value, 1) for name, value in areas.items()}
    prior = {}
    if coverage.pos is not None and coverage.poa_on_map is not None:
        by_prior = {"on_map": coverage.poa_on_map, "probability_of_success": coverage.pos}
        prior = {"prior": {name: round(value, 4) for name, value in by_prior.items()}}
    pod = {} if coverage.mean_pod is None else {"mean_pod": round(coverage.mean_pod, 4)}
    return {
        "basis": coverage.basis,
        **rounded,
        **pod,
        **prior,
        "scope": coverage.scope,
        "said": list(coverage.sentences),
    }


def _truth(match: TruthMatch) -> dict[str, Any]:
    mean = match.mean_distance_m
    return {
        "people": match.people,
        "radius_m": MATCH_RADIUS_M,
        "found": [
            {"place": f.location, "person": f.person, "distance_m": round(f.distance_m, 3)}
            for f in match.found
        ],
        "missed": list(match.missed),
        "false": list(match.false),
        "mean_distance_m": None if mean is None else round(mean, 4),
    }


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

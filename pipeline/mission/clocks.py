"""The clocks of the streams of one mission: which of them can be believed, and how far apart they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pipeline.ingest.finding import Finding
from pipeline.ingest.trajectory import Trajectory

#: clocks that differ by a time zone differ by a multiple of this, and by no more than so much beside it, seconds
_ZONE_STEP_S, _ZONE_SLACK_S, _MOST_ZONE_S = 900.0, 120.0, 26 * 3600.0
#: at pace realtime nobody waits longer than this for a flight that was later, seconds
LONGEST_WAIT_S = 10.0


def settled(streams: Sequence[tuple[str, Trajectory, float]]) -> tuple[list[Trajectory], list[Finding]]:
    """The trajectories on one clock, and what was assumed for that. streams: name, trajectory, video's seconds.

    A stream without dates is taken to begin with the first one that has them. Streams of local time that do not
    overlap, and are apart by a time zone, are taken to have flown together: a drone whose clock was not set must
    not make the others' evidence late. Clocks that are known to be UTC are left as they
    are, with a warning if they are apart by a zone.
    """
    dated = [(t, s) for _, t, s in streams if t.clock != "unknown"]
    if not dated:
        text = "telemetry without dates; times are those of the video, and all flights are taken to begin together"
        return [t for _, t, _ in streams], [
            Finding("assumed", "clock_unknown", name, text) for name, _, _ in streams
        ]
    reference, reference_s = dated[0]
    result, findings = [], []
    for name, trajectory, duration_s in streams:
        moved, finding = _on(reference, reference_s, name, trajectory, duration_s)
        result.append(moved)
        findings += [finding] if finding is not None else []
    return result, findings


def _on(
    reference: Trajectory, reference_s: float, name: str, trajectory: Trajectory, duration_s: float
) -> tuple[Trajectory, Finding | None]:
    if trajectory.clock == "unknown":
        text = "telemetry without dates; the flight is taken to begin with the first other one"
        moved = replace(trajectory, start_ns=reference.start_ns, clock="local")
        return moved, Finding("assumed", "clock_unknown", name, text)
    ahead_s = (trajectory.start_ns - reference.start_ns) * 1e-9
    overlap = -duration_s < ahead_s < reference_s
    if overlap:
        return trajectory, None
    zone_s = _ZONE_STEP_S * round(ahead_s / _ZONE_STEP_S)
    is_zone = zone_s != 0.0 and abs(ahead_s - zone_s) <= _ZONE_SLACK_S and abs(zone_s) <= _MOST_ZONE_S
    if not is_zone:
        return trajectory, _apart(name, ahead_s)
    found = f"its clock is {_hours(zone_s)} {'ahead of' if zone_s > 0 else 'behind'} the first stream's"
    apart = f"the flights begin {ahead_s:.1f} s apart, a multiple of a quarter of an hour to {_ZONE_SLACK_S:.0f} s"
    if trajectory.clock == reference.clock == "utc":
        text = f"{found}; taken for a later flight, since both are said to be UTC"
        mend = "if they flew at one time: telemetry.utc_offset, what the drone's clock showed less UTC"
        return trajectory, Finding("warning", "time_zone", name, text, apart, mend)
    finding = Finding(
        "warning",
        "time_zone",
        name,
        f"{found}; taken for another time zone, so that both flew at one time",
        apart,
        "telemetry.utc_offset of each stream: the local time minus UTC that its drone's clock shows",
    )
    return replace(trajectory, start_ns=trajectory.start_ns - round(zone_s * 1e9)), finding


def _apart(name: str, ahead_s: float) -> Finding:
    """A flight at another time than the first stream's, and by no time zone."""
    text = f"its flight begins {_duration(abs(ahead_s))} {'after' if ahead_s > 0 else 'before'} the first stream's"
    mend = (
        f"if they flew at one time: telemetry.utc_offset {ahead_s:+.0f} s against the first stream's, "
        "which is what its clock was ahead"
    )
    evidence = "the two flights do not overlap, and are apart by no multiple of a quarter of an hour"
    if abs(ahead_s) > _MOST_ZONE_S:
        found = f"{text}, which is no part of one search; was its clock set?"
        return Finding("warning", "time_apart", name, found, evidence, mend)
    return Finding("assumed", "time_apart", name, f"{text}; taken for another flight", evidence, mend)


def _duration(seconds: float) -> str:
    for unit_s, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * unit_s:
            return f"{seconds / unit_s:.1f} {unit}"
    return f"{seconds:.1f} s"


def _hours(zone_s: float) -> str:
    return f"{abs(zone_s) / 3600.0:g} h"


def pacing_offsets_s(starts_ns: Sequence[int], durations_s: Sequence[float]) -> list[float]:
    """When each stream begins at pace realtime, seconds after the first; long pauses between flights are cut."""
    order = sorted(range(len(starts_ns)), key=lambda k: starts_ns[k])
    offsets = [0.0] * len(starts_ns)
    cut_s, end_s = 0.0, 0.0
    for k in order:
        begin_s = (starts_ns[k] - starts_ns[order[0]]) * 1e-9 - cut_s
        if begin_s > end_s + LONGEST_WAIT_S:
            cut_s += begin_s - end_s - LONGEST_WAIT_S
            begin_s = end_s + LONGEST_WAIT_S
        offsets[k], end_s = begin_s, max(end_s, begin_s + durations_s[k])
    return offsets

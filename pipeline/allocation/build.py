"""From a mission, an inventory and a pool to the allocation problem (the paper's Algorithm det_ass).

What goes past the paper is in ``levels`` (codecs, expected size) and ``sharing``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

from pipeline.allocation.levels import Level, accuracies_of, levels_of, stream_accuracies
from pipeline.allocation.problem import Deadline, Detector, MachineLimit, Problem
from pipeline.allocation.sharing import sharing_modes
from pipeline.config.inventory import Inventory
from pipeline.config.pool import Pool, PoolDetector
from pipeline.config.processing import Processing
from pipeline.errors import InputError
from pipeline.sensor.setup import Setup, setup_of

#: 0.1 s at 30 Hz is 3 frames, not the 4 that the float product 3.0000000000000004 would give
_ROUNDING = 1e-9


def build_problem(
    streams: Mapping[str, str],
    processing: Processing,
    inventory: Inventory,
    pool: Pool,
    *,
    where: Path,
    person_px: Mapping[str, float] | None = None,
) -> Problem:
    """The problem of a mission. streams: own site by stream id. where: the mission file, for messages.
    person_px: expected size of a person by stream (see ``geo.expected_size``), for processing.expected_size.

    A stream reaches its own site without a limit; a site that the inventory does not have (a drone without a
    computer) is no place to detect at. A detector's time is its stated maximum, else its mean: the text
    derives periods from the worst case, the paper's own table from the means.

    Raises InputError for a machine type without times, a detector without a machine, a stream without a link,
    bitrates that no link carries, and when no detector is fast enough.
    """
    machines = tuple(machine for machine, _ in _machines(inventory))
    _check_types(inventory, pool, where)
    links = _links(streams, inventory, where)
    levels = levels_of(processing, _bitrates(processing, links, where))
    delays = processing.delays
    return Problem(
        streams=tuple(streams),
        sites=tuple(site.id for site in inventory.sites),
        machines=machines,
        detectors=_detectors(processing, inventory, pool, levels, where),
        bitrates_bps=tuple(level.bitrate_bps for level in levels),
        link_bps=links,
        frame_rate_hz=processing.frame_rate,
        detectors_per_stream=processing.detectors_per_stream,
        detectors_per_frame=processing.detectors_per_frame,
        accuracy_weight=processing.accuracy_weight,
        memory_rule=processing.memory_rule,
        stream_accuracy=stream_accuracies(processing, pool, levels, person_px or {}, where),
        deadline=None
        if delays is None
        else Deadline(processing.max_processing_time, delays.encode, delays.decode, delays.burst),
        codecs=tuple(level.codec for level in levels) if processing.codecs else (),
    )


def period_of(time_s: float, frame_rate_hz: float) -> int:
    """Eq. period: ceil(time_d * processingFrameRate), at least 1."""
    return max(1, math.ceil(time_s * frame_rate_hz - _ROUNDING))


def max_frame_time_s(processing: Processing) -> float:
    """Algorithm det_ass, first line: min(maxProcessingTime, detPerStream / processingFrameRate)."""
    return min(processing.max_processing_time, processing.detectors_per_stream / processing.frame_rate)


def _machines(inventory: Inventory) -> Iterator[tuple[MachineLimit, str]]:
    """Every machine, each copy by its own name, with its type."""
    for site in inventory.sites:
        for machine in site.machines:
            for name in machine.names:
                yield MachineLimit(name, site.id, machine.memory), machine.type


def _check_types(inventory: Inventory, pool: Pool, where: Path) -> None:
    owned = {machine.type: machine.id for site in inventory.sites for machine in site.machines}
    timed = {time.machine for detector in pool.detectors for time in detector.times}
    for kind, machine in owned.items():
        if kind not in timed:
            raise InputError(
                f"{where} inventory machine {machine}.type",
                repr(kind),
                f"a machine type of the pool: {_names(timed)}",
            )
    _check_providers(inventory, pool, where)
    for detector in pool.detectors:
        kinds = {time.machine for time in detector.times}
        if not kinds & owned.keys():
            raise InputError(
                f"{where} pool.detectors.{detector.id}.times",
                f"only machines that are not there: {_names(kinds)}",
                f"a time on a machine type of the inventory: {_names(set(owned))}",
            )


def _check_providers(inventory: Inventory, pool: Pool, where: Path) -> None:
    """A time that was measured with CUDA says nothing of a machine that the inventory gives none."""
    for machine in (m for site in inventory.sites for m in site.machines):
        for detector in pool.detectors:
            for time in detector.times:
                if time.machine == machine.type and (time.provider or machine.provider) != machine.provider:
                    raise InputError(
                        f"{where} inventory machine {machine.id}.provider",
                        machine.provider,
                        f"{time.provider}, with which the pool timed {detector.id} on {machine.type}",
                    )


def _names(names: set[str]) -> str:
    return ", ".join(sorted(names))


def _links(streams: Mapping[str, str], inventory: Inventory, where: Path) -> dict[tuple[str, str], float]:
    sites = {site.id for site in inventory.sites}
    links = {(link.stream, link.site): link.bandwidth for link in inventory.links if link.stream in streams}
    links |= {(stream, own): math.inf for stream, own in streams.items() if own in sites}
    for stream, own in streams.items():
        if not any(links.get((stream, site), 0.0) > 0.0 for site in sites):
            raise InputError(
                f"{where} streams.{stream}",
                f"no link to any site, and no site {own!r} of its own",
                f"a link in the inventory to one of: {_names(sites)}",
            )
    return links


def _bitrates(
    processing: Processing, links: Mapping[tuple[str, str], float], where: Path
) -> tuple[float, ...]:
    """B: the levels that are not above every link (the paper's max_link_bw), ascending."""
    field = f"{where} processing.bitrates"
    for bitrate in processing.bitrates:
        if processing.bitrates.count(bitrate) > 1:
            raise InputError(field, f"{bitrate:g} bps twice", "each bitrate once")
    widest = max(links.values())
    usable = tuple(sorted(bitrate for bitrate in processing.bitrates if bitrate <= widest))
    if not usable:
        raise InputError(
            field,
            f"only bitrates above every link, {min(processing.bitrates):g} bps and more",
            f"one of at most {widest:g} bps",
        )
    return usable


def _detectors(
    processing: Processing, inventory: Inventory, pool: Pool, levels: tuple[Level, ...], where: Path
) -> tuple[Detector, ...]:
    """getDetectors of Algorithm det_ass: every network on every machine where it is fast enough."""
    limit_s = max_frame_time_s(processing)
    accuracies = {d.id: accuracies_of(d, levels, processing.codec, where) for d in pool.detectors}
    timed = [
        (network, machine, time.mean if time.maximum is None else time.maximum, setup_of(network, time))
        for machine, kind in _machines(inventory)
        for network in pool.detectors
        for time in network.times
        if time.machine == kind
    ]
    if min(time_s for _, _, time_s, _ in timed) > limit_s + _ROUNDING:
        _refuse_slow(processing, timed, limit_s, where)
    return tuple(
        Detector(
            id=f"{machine.id}:{network.id}{mode.suffix}",
            detector=network.id,
            machine=machine.id,
            site=machine.site,
            period=period_of(time_s * mode.factor, processing.frame_rate),
            memory_bytes=network.memory,
            accuracy=accuracies[network.id],
            execution_s=time_s * mode.factor,
            sharing=mode.detectors,
            setup=setup,
        )
        for network, machine, time_s, setup in timed
        for mode in sharing_modes(processing, network, where)
        if time_s * mode.factor <= limit_s + _ROUNDING
    )


def _refuse_slow(
    processing: Processing,
    timed: list[tuple[PoolDetector, MachineLimit, float, Setup]],
    limit_s: float,
    where: Path,
) -> None:
    network, machine, time_s, _ = min(timed, key=lambda found: found[2])
    raise InputError(
        f"{where} processing",
        f"no detector that is fast enough; the fastest, {network.id} on {machine.id}, takes {time_s:g} s",
        f"at most {limit_s:g} s, the lesser of max_processing_time {processing.max_processing_time:g} s and "
        f"detectors_per_stream / frame_rate {processing.detectors_per_stream / processing.frame_rate:g} s",
    )

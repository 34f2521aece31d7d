"""The detectors of a mission's pool: whether they can be used, and which layers of the map they know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pipeline.allocation.plan import Assignment
from pipeline.config.mission import Mission
from pipeline.config.pool import Pool
from pipeline.detection import Detector, open_pool_detector
from pipeline.detection.crash_test import survived
from pipeline.errors import InputError
from pipeline.ingest.finding import Finding
from pipeline.mission.simulated_only import knows_simulation_only


@dataclass(frozen=True)
class PoolLook:
    """findings: what was assumed of models. known: names of the layers that each detector with a model knows.
    picture_sizes: width and height that each of them makes of a picture, by id; None: it looks at it as it is.
    input_sizes: of the networks; None: any. simulated: ids of those that have seen simulated people only.
    """

    findings: tuple[Finding, ...]
    known: Mapping[str, frozenset[str]]
    picture_sizes: Mapping[str, tuple[int, int] | None]
    input_sizes: Mapping[str, tuple[int, int] | None]
    simulated: tuple[str, ...] = ()


def layers_of(mission: Mission) -> dict[str, int]:
    """The ids of the map's layers by name."""
    return {c.name: c.id for c in mission.fusion.classes}


def look_at_detectors(pool: Pool, layers: Mapping[str, int], where: Path) -> PoolLook:
    """Open every model of the pool, each in a child process first.

    Raises InputError for the first that cannot be used, and for a layer of the map that none of them knows.
    """
    with_model = [d for d in pool.detectors if d.model is not None]
    reasons = survived([d.model for d in with_model if d.model is not None])
    findings, known, sizes, simulated = [], {}, {}, []
    inputs: dict[str, tuple[int, int] | None] = {}
    for detector in with_model:
        reason = None if detector.model is None else reasons[detector.model]
        if reason is not None:
            raise InputError(detector.model, reason, "a model that ONNX Runtime can run")
        opened = open_pool_detector(detector, layers)
        known[detector.id] = frozenset(name for name, number in layers.items() if number in opened.class_ids)
        findings += _assumed(detector.id, opened)
        sizes[detector.id], inputs[detector.id] = opened.picture_size, opened.input_size
        simulated += [detector.id] if knows_simulation_only(opened) else []
        if detector.assumed is not None:
            findings.append(Finding("assumed", "detector_row", f"detector {detector.id}", detector.assumed))
    if known:
        require_layers(layers, known, where, f"detector of the pool ({', '.join(known)})")
    return PoolLook(tuple(findings), known, sizes, inputs, tuple(simulated))


def require_planned_layers(
    layers: Mapping[str, int],
    known: Mapping[str, frozenset[str]],
    assignments: tuple[Assignment, ...],
    where: Path,
) -> None:
    """Raises InputError for a layer of the map that no detector of a plan knows."""
    planned = {a.pool_detector: known[a.pool_detector] for a in assignments if a.pool_detector in known}
    if planned:
        require_layers(layers, planned, where, f"planned detector ({', '.join(planned)})")


def require_layers(
    layers: Mapping[str, int], known: Mapping[str, frozenset[str]], where: Path, who: str
) -> None:
    """Raises InputError for a layer that nobody knows: nothing would ever lower or raise it."""
    everybody = frozenset().union(*known.values())
    for name in layers:
        if name not in everybody:
            raise InputError(
                f"{where} classes.{name}",
                f"no {who} that knows {name}",
                f"one that does, classes: {{{name}: [..]}} in the pool, or no such layer in fusion",
            )


def _assumed(name: str, detector: Detector) -> list[Finding]:
    found = detector.recognised
    if found is None:
        return []
    layout = f"read as {found.name}"
    return [
        Finding(
            "assumed", "detector_layout", f"detector {name}", sentence, layout, "layout, names in the pool"
        )
        for sentence in found.assumed
    ]

"""The levels at which a stream can be sent, and how accurate a detector is at each.

A level is a bitrate or, past the paper's evaluation, a bitrate with a codec ("the number of encoding bitrate
levels can be multiplied by the number of available codecs"). Accuracy may depend on the stream too: on the
size that a person is expected to have in its pictures.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pipeline.config.pool import AccuracyAt, Pool, PoolDetector
from pipeline.config.processing import Processing
from pipeline.errors import InputError
from pipeline.link.codec import Codec
from pipeline.sensor.accuracy import accuracy_at

#: COCO's size classes, pixels: up to, and its name
_SIZES = ((32.0, "small"), (96.0, "medium"), (math.inf, "large"))


@dataclass(frozen=True)
class Level:
    """codec: empty where the mission has but one."""

    bitrate_bps: float
    codec: Codec | Literal[""]


def levels_of(processing: Processing, bitrates_bps: tuple[float, ...]) -> tuple[Level, ...]:
    """All levels, by ascending bitrate. bitrates_bps: ascending."""
    codecs: tuple[Codec | Literal[""], ...] = processing.codecs or ("",)
    return tuple(Level(bps, codec) for bps in bitrates_bps for codec in codecs)


def accuracies_of(
    network: PoolDetector, levels: tuple[Level, ...], codec: Codec, where: Path
) -> tuple[float, ...]:
    """acc_d^b, one per level. codec: the mission's, where the levels have none.

    Raises InputError for a codec among the levels that the pool has nothing of.
    """
    return tuple(
        accuracy_at(_points(network, level.codec, codec, where), level.bitrate_bps) for level in levels
    )


def stream_accuracies(
    processing: Processing, pool: Pool, levels: tuple[Level, ...], person_px: Mapping[str, float], where: Path
) -> dict[tuple[str, str], tuple[float, ...]]:
    """Accuracies for the size of a person expected in each stream, by (stream, detector); see Problem.

    Where the pool has none of that size the detector's own stay. With codecs the accuracy of a size is scaled
    as the codec's is to that of all sizes.
    """
    if not processing.expected_size:
        return {}
    found = {}
    for stream, size_px in person_px.items():
        for network in pool.detectors:
            points = of_size(network, size_px)
            if points:
                found[stream, network.id] = tuple(
                    _scaled(network, points, level, processing.codec, where) for level in levels
                )
    return found


def of_size(network: PoolDetector, size_px: float) -> tuple[AccuracyAt, ...]:
    """The pool's rows for people of this size (root of the box's area, pixels): the finest that it has."""
    rows: tuple[AccuracyAt, ...] = tuple(
        row
        for row in network.accuracy_by_context
        if row.person_px_from <= size_px < (math.inf if row.person_px_below is None else row.person_px_below)
    )
    name = next(name for most_px, name in _SIZES if size_px <= most_px)
    return rows or tuple(row for row in network.accuracy_by_size if row.size == name)


def _points(network: PoolDetector, codec: str, of_mission: Codec, where: Path) -> tuple[AccuracyAt, ...]:
    """Of a level's codec; where it has none of the mission's, or whatever the pool has."""
    points = tuple(row for row in network.accuracy_by_codec if row.codec == (codec or of_mission))
    if not codec:
        return points or network.accuracy
    if not points:
        raise InputError(
            f"{where} pool.detectors.{network.id}.accuracy_by_codec",
            f"nothing for {codec}, which is one of processing.codecs",
            "rows for every codec of processing.codecs",
        )
    return points


def _scaled(
    network: PoolDetector, points: tuple[AccuracyAt, ...], level: Level, of_mission: Codec, where: Path
) -> float:
    """The accuracy of a size under the level's codec: as the codec's is to the detector's own."""
    accuracy = accuracy_at(points, level.bitrate_bps)
    everything = accuracy_at(network.accuracy, level.bitrate_bps)
    there = accuracy_at(_points(network, level.codec, of_mission, where), level.bitrate_bps)
    return accuracy if there == everything else min(1.0, accuracy * there / max(everything, 1e-9))

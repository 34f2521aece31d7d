"""Writes what a later flight needs to go on with a run's map, see ``onto``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack
import numpy as np

from pipeline.fusion.fuser import Fuser
from pipeline.fusion.look import Look
from pipeline.fusion.map_file import map_records
from pipeline.messages import FloatArray
from pipeline.mission.found_place_crops import Crop
from pipeline.mission.onto import KIND, LOOK_FIELDS, fingerprint
from pipeline.mission.prepared import PreparedMission
from pipeline.outputs.accounting import StreamAccount
from pipeline.outputs.earlier_flight import EarlierFlight, flight_to_json
from pipeline.outputs.summary import Summary
from pipeline.storage.checksummed import write_records

#: between the name of a stream and the number of its flight; no stream of a mission has it in its name
_OF_FLIGHT = "#"


def save_run_state(
    path: Path,
    prepared: PreparedMission,
    fuser: Fuser,
    summary: Summary,
    tracks: Mapping[str, FloatArray],
    crops: Sequence[Crop],
) -> None:
    """Write the state of a finished run, whole or not at all. tracks: of this flight and of those before it."""
    number = len(summary.earlier) + 1
    flight = _flight(number, prepared, summary)
    of_state = {
        "classes": list(fuser.maps),
        "height_datum": prepared.heights.datum,
        "look_fields": LOOK_FIELDS,
        "looks": [_values(_renamed(look, number)) for look in fuser.looks],
        "flights": [flight_to_json(f) for f in (*summary.earlier, flight)],
        "tracks": [(_name(s, number), np.ascontiguousarray(t[:, :3]).tobytes()) for s, t in tracks.items()],
        "crops": [(_renamed(crop.sighting, number).order, crop.png) for crop in crops],
    }
    write_records(path, KIND, _records(of_state, fuser))


def _records(state: dict[str, Any], fuser: Fuser) -> Iterator[bytes]:
    yield msgpack.packb(state)
    for voxel_map in fuser.maps.values():
        yield from map_records(voxel_map)


def _flight(number: int, prepared: PreparedMission, summary: Summary) -> EarlierFlight:
    streams = prepared.streams
    return EarlierFlight(
        number,
        summary.mission,
        summary.mission_file,
        summary.pace,
        summary.clock,
        min(s.start_ns for s in streams),
        max(s.start_ns + round(s.end_s * 1e9) for s in streams),
        tuple(
            StreamAccount(_name(a.stream, number), a.captured, a.processed, a.dropped)
            for a in summary.streams
        ),
        sum(substream.detections for substream in summary.substreams),
        dict(summary.not_taken),
        tuple(sorted(fingerprint(s) for s in streams)),
    )


def _name(stream: str, number: int) -> str:
    """Of a stream in later runs; those of earlier flights have theirs already."""
    return stream if _OF_FLIGHT in stream else f"{stream}{_OF_FLIGHT}{number}"


def _renamed(look: Look, number: int) -> Look:
    return replace(look, stream=_name(look.stream, number))


def _values(look: Look) -> list[Any]:
    values = [getattr(look, name) for name in LOOK_FIELDS]
    return [value.tolist() if isinstance(value, np.ndarray) else value for value in values]

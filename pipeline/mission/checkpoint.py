"""The reducer's state as a file, so that a mission can go on where it stopped."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import fields
from itertools import chain, islice
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgpack
import numpy as np

from pipeline.errors import InputError
from pipeline.fusion.fuser_state import FuserState
from pipeline.fusion.look import Look
from pipeline.fusion.map_file import map_records, restore_map
from pipeline.fusion.replay import Log
from pipeline.fusion.sequencer import SequencerState
from pipeline.messages import Detections, pack, unpack
from pipeline.mission.stages.latency import HopHistogram
from pipeline.mission.stages.reducer import ReducerStage
from pipeline.storage.checksummed import read_records, write_records
from pipeline.storage.disk import LOCAL_DISK, Disk

NOTHING: Mapping[str, Any] = MappingProxyType({})
KIND = "searchlight reducer 5"


def save_checkpoint(
    path: Path, stage: ReducerStage, beside: Mapping[str, Any] = NOTHING, disk: Disk = LOCAL_DISK
) -> None:
    """Write all that a reducer knows; until all of it is on the disk, path stays as it was. Raises OSError.

    beside: what is to be known before the reducer is read, plain values by name.
    """
    write_records(path, KIND, chain([msgpack.packb(dict(beside))], state_records(stage)), disk)


def read_beside(path: Path, disk: Disk = LOCAL_DISK) -> dict[str, Any]:
    """What was written beside a reducer's state. Raises InputError if the file is not whole."""
    beside: dict[str, Any] = msgpack.unpackb(
        next(read_records(path, KIND, disk)), strict_map_key=False, use_list=False
    )
    return beside


def load_checkpoint(path: Path, stage: ReducerStage, disk: Disk = LOCAL_DISK) -> None:
    """Let a new reducer of the same mission go on where another one stopped.

    Raises InputError, and leaves the reducer as it was, if the file is damaged or of another mission.
    """
    records = islice(read_records(path, KIND, disk), 1, None)
    state = msgpack.unpackb(next(records), strict_map_key=False, use_list=False)
    mine = {"substreams": stage.begun_with, "classes": tuple(stage.fuser.maps)}
    for name, expected in mine.items():
        if state[name] != expected:
            raise InputError(f"{path} {name}", repr(state[name]), f"{expected!r}, as this mission's")
    for voxel_map in stage.fuser.maps.values():
        restore_map(path, voxel_map, records)
    _restore_fuser(stage, state)
    _restore_sequencer(stage, state["sequencer"])
    _restore_accounts(stage, state)


def state_records(stage: ReducerStage) -> Iterator[bytes]:
    """All that a reducer knows; the same state, the same bytes.

    The map and what the fuser knows are those before the log of the last results, see ``Replay``.
    """
    yield msgpack.packb(_state(stage))
    for name, voxel_map in stage.fuser.maps.items():
        yield from map_records(voxel_map, stage.replay.before(name))


def _state(stage: ReducerStage) -> dict[str, Any]:
    sequencer, log = stage.sequencer.state, stage.replay.log
    fuser = log.state
    return {
        "substreams": stage.begun_with,
        "classes": list(stage.fuser.maps),
        "looks": [[_plain(getattr(look, f.name)) for f in fields(Look)] for look in fuser.looks],
        "fuser_refused": fuser.refused,
        "unplaced": fuser.unplaced,
        "sizes": sorted(fuser.sizes.items()),
        "last_ns": sorted(fuser.last_ns.items()),
        "viewpoints": sorted(fuser.newest.items()),
        "replay": {
            "base": log.base,
            "entries": [(order, number, pack(result)) for order, number, result in log.entries],
            "latest_ns": log.latest_ns,
            "late": sorted(stage.replay.late.items()),
            "out_of_place": sorted(stage.replay.out_of_place.items()),
        },
        "sequencer": {
            "open": sequencer.open,
            "newest_ns": sorted(sequencer.newest_ns.items()),
            "applied_ns": [(key, times.tobytes()) for key, times in sorted(sequencer.applied_ns.items())],
            "waiting": [pack(result) for result in sequencer.waiting],
            "released": sequencer.released,
            "refused": sorted(sequencer.refused.items()),
            "late": sorted(sequencer.late.items()),
            "closed": sequencer.closed,
        },
        "received": [(key, sorted(frames)) for key, frames in sorted(stage.received.items())],
        "processed": [(key, sorted(frames)) for key, frames in sorted(stage.processed.items())],
        "dropped": [(key, sorted(frames.items())) for key, frames in sorted(stage.dropped.items())],
        "detections": sorted(stage.detections.items()),
        "closed": sorted(stage.closed.items()),
        "opened": sorted(stage.opened.items()),
        "hops": [
            (key, [(hop, h.counts, h.sum_s) for hop, h in hops.items()])
            for key, hops in sorted(stage.hops.items())
        ],
    }


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _restore_fuser(stage: ReducerStage, state: dict[str, Any]) -> None:
    looks = tuple(_look(values) for values in state["looks"])
    replay = state["replay"]
    unpacked = ((order, number, unpack(data)) for order, number, data in replay["entries"])
    entries = tuple((*at, result) for *at, result in unpacked if isinstance(result, Detections))
    known = FuserState(
        looks,
        state["fuser_refused"],
        state["unplaced"],
        dict(state["sizes"]),
        dict(state["last_ns"]),
        dict(state["viewpoints"]),
    )
    stage.replay.go_on(Log(known, replay["base"], entries, replay["latest_ns"]))
    stage.replay.late, stage.replay.out_of_place = (
        Counter(dict(replay[k])) for k in ("late", "out_of_place")
    )


def _look(values: tuple[Any, ...]) -> Look:
    arguments: list[Any] = [np.array(v) if isinstance(v, tuple) else v for v in values]
    return Look(*arguments)


def _restore_sequencer(stage: ReducerStage, state: dict[str, Any]) -> None:
    waiting = [unpack(data) for data in state["waiting"]]
    stage.sequencer.restore(
        SequencerState(
            list(state["open"]),
            dict(state["newest_ns"]),
            {key: array("q", times) for key, times in state["applied_ns"]},
            [result for result in waiting if isinstance(result, Detections)],
            state["released"],
            dict(state["refused"]),
            dict(state["late"]),
            list(state["closed"]),
        )
    )


def _restore_accounts(stage: ReducerStage, state: dict[str, Any]) -> None:
    stage.closed = dict(state["closed"])
    stage.learn(dict(state["opened"]))
    stage.received = {key: set(frames) for key, frames in state["received"]}
    stage.processed = {key: set(frames) for key, frames in state["processed"]}
    stage.dropped = {key: dict(frames) for key, frames in state["dropped"]}
    stage.count_again()
    stage.detections = Counter(dict(state["detections"]))
    stage.hops = {
        key: {hop: HopHistogram(list(counts), sum_s) for hop, counts, sum_s in hops}
        for key, hops in state["hops"]
    }

"""What a run shows of itself while it flies: ``live/`` of its directory, see ``pipeline.view.files``.

The map is copied tile by tile, the lock of its owner held for one tile at a time, and all else is done on the
copy. A snapshot is written when something has changed, at most every PERIOD_S, and so seldom that it takes no more than
SHARE of the time.
"""

from __future__ import annotations

import copy
import json
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.allocation.plan import Assignment, Plan
from pipeline.fusion.possible import found_and_possible
from pipeline.fusion.tiles import Tiles
from pipeline.fusion.voxel_map import VoxelMap
from pipeline.geo.search_area import load_search_area
from pipeline.ingest.video.recordings import Recordings
from pipeline.logs import Log
from pipeline.mission.flown import Flown, as_flown
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.stages.reducer import ReducerStage
from pipeline.mission.stages.source import StreamInput
from pipeline.outputs.live_names import FOUND, LIVE, POSSIBLE, REDUCER, STATUS
from pipeline.outputs.salient_geojson import write_salient
from pipeline.outputs.verdict import judge
from pipeline.storage.whole_or_nothing import make_folder, write_bytes, write_text
from pipeline.view.files import GROUND, MAP, POSES, SIGHTINGS
from pipeline.view.ground import ground_of
from pipeline.view.layer import layer_of
from pipeline.view.poses import Flight, encoded
from pipeline.view.sightings import sightings_json

#: between two snapshots, seconds
PERIOD_S = 1.0
#: of one core, at most
SHARE = 0.1
#: poses a second that are kept of a flight, at most
POSES_HZ = 5.0
#: while a live mission flies, poses of each drone's way so far, at most; and between two writings, seconds
MOST_LIVE_POSES, WAYS_S = 1000, 2.0
#: tiles of a map that is shown while it grows: 2 GiB of voxels
MOST_TILES = 1024
_LOG = Log("mission")


def write_flight(folder: Path, prepared: PreparedMission) -> None:
    """Write what is known before the first picture: the ground, and where the cameras are when."""
    write_ground(folder, prepared)
    write_bytes(folder / POSES, encoded([_flight(prepared, s, POSES_HZ) for s in prepared.streams]))


def write_ground(folder: Path, prepared: PreparedMission) -> None:
    """Write the heights and the search area."""
    mission = prepared.mission
    area = []
    if mission.search_area is not None:
        polygons = load_search_area(mission.search_area, prepared.frame).polygons
        area = [ring for rings in polygons for ring in rings]
    write_bytes(folder / GROUND, ground_of(prepared.terrain, area).encoded())


class LiveWays:
    """Where the drones of a live mission have flown so far, written now and then. folder: ``live/``."""

    def __init__(self, folder: Path, prepared: PreparedMission) -> None:
        self._folder, self._prepared, self._due_s = folder, prepared, 0.0

    def write_if_due(self, flown: Callable[[], Flown], now_s: float) -> None:
        """A disk that does not take it is said in the log: it is not worth a run."""
        if not self._prepared.mission.is_live or now_s < self._due_s or not self._folder.is_dir():
            return
        self._due_s = now_s + WAYS_S
        over = as_flown(self._prepared, flown())
        rate_hz = min(POSES_HZ, MOST_LIVE_POSES / max(s.end_s for s in over.streams))
        try:
            write_bytes(self._folder / POSES, encoded([_flight(over, s, rate_hz) for s in over.streams]))
        except OSError as error:
            _LOG.warning("live view not written", error=str(error))


def _flight(prepared: PreparedMission, stream: StreamInput, most_hz: float) -> Flight:
    rate_hz = min(most_hz, stream.processing_rate_hz)
    times = np.arange(stream.video.start_s, stream.end_s, 1.0 / rate_hz)
    poses = [(float(t), pose) for t in times if (pose := stream.trajectory.pose(float(t))) is not None]
    source = stream.source
    files = zip(source.paths, source.offsets_s, strict=True) if isinstance(source, Recordings) else ()
    return Flight(
        stream.stream,
        stream.site,
        prepared.cameras[stream.stream],
        stream.start_ns,
        tuple((str(path.absolute()), float(offset)) for path, offset in files),
        np.array([t for t, _ in poses]),
        np.array([pose.position_enu for _, pose in poses]).reshape(-1, 3),
        np.array([pose.enu_from_camera for _, pose in poses]).reshape(-1, 3, 3),
        np.array([pose.focal_scale for _, pose in poses]),
    )


def begin_live(run: Path, prepared: PreparedMission) -> Path:
    """A new ``live/`` in a run directory, with what is known before the first picture."""
    end_live(run)
    make_folder(run / LIVE)
    write_flight(run / LIVE, prepared)
    return run / LIVE


def end_live(run: Path) -> None:
    """Remove it: the map is written, or there is none."""
    shutil.rmtree(run / LIVE, ignore_errors=True)


def write_status(folder: Path, status: Mapping[str, Any]) -> None:
    """What the actors say. Not worth a run: a disk that does not take it is said in the log."""
    try:
        stamped = {"at": _now()} | dict(status)
        write_text(folder / STATUS, json.dumps(stamped, ensure_ascii=False, allow_nan=False) + "\n")
    except OSError as error:
        _LOG.warning("live view not written", error=str(error))


def write_local_status(
    folder: Path, prepared: PreparedMission, plan: Plan, stage: ReducerStage, seconds: float
) -> None:
    """What a run in one process says: its one actor is the reducer."""
    streams = {
        s.stream: {
            "captured": s.video.pictures,
            "processed": len(stage.frames(s.stream)),
            "dropped": stage.frames_dropped(s.stream),
        }
        for s in prepared.streams
    }
    said = {"pace": "local", "seconds": round(seconds, 1), "streams": streams}
    write_status(folder, {"mission": prepared.mission.name, "plan": plan_lines(plan.assignments)} | said)


def plan_lines(assignments: Sequence[Assignment]) -> list[dict[str, Any]]:
    """Who looks at what, as plain values."""
    return [
        {
            "stream": a.stream,
            "detector": a.detector,
            "machine": a.machine,
            "site": a.site,
            "period": a.period,
            "bitrate_bps": a.bitrate_bps,
        }
        for a in assignments
    ]


@dataclass(frozen=True)
class MapFigures:
    """Of one snapshot. places, possible: found. searched_m2: ground that was looked at, by the first class's layer."""

    places: int
    possible: int
    searched_m2: float


class LiveMap:
    """Writes snapshots of one reducer's map. figures: of the last one; None where a map is too large to be shown."""

    def __init__(self, folder: Path, prepared: PreparedMission) -> None:
        """folder: ``live/``; nothing is written where there is none."""
        self.folder, self._prepared = folder, prepared
        self._shadows: dict[str, VoxelMap] = {}
        self._written: object = None
        self.due_s = 0.0
        self.cost_s = 0.0
        self.figures: MapFigures | None = None

    def write_if_due(
        self, stage: ReducerStage, now_s: float, lock: AbstractContextManager[Any] | None = None
    ) -> bool:
        """Write a snapshot if it is time, and something has changed; whether it did. lock: of the stage's owner."""
        if now_s < self.due_s or not self.folder.is_dir():
            return False
        begun = time.thread_time()  # waiting for others costs nobody anything
        try:
            written = self.write(stage, lock)
        except OSError as error:
            _LOG.warning("live view not written", error=str(error))
            written = False
        self.cost_s = time.thread_time() - begun
        self.due_s = now_s + max(PERIOD_S, self.cost_s * (1.0 / SHARE - 1.0))
        return written

    def write(self, stage: ReducerStage, lock: AbstractContextManager[Any] | None = None) -> bool:
        """Write a snapshot if something has changed; whether it did."""
        lock = lock or nullcontext()
        with lock:
            stage.settle()
            state = _counts(stage)
            looks = tuple(stage.fuser.looks)
        key = (len(looks), json.dumps(state, sort_keys=True))
        if key == self._written:
            return False
        # a map that grew too large to be shown is not copied: its last snapshot says when it was
        shown = all(m.tiles.touched.sum() <= MOST_TILES for m in stage.fuser.maps.values())
        maps = {name: self._copied(name, m, lock) for name, m in stage.fuser.maps.items()} if shown else {}
        params, fuser = self._prepared.mission.fusion, stage.fuser
        found, possible = found_and_possible(maps, looks, params) if shown else ((), ())
        boxes = sum(state["detections"].values())
        verdict = judge(found, None, state["not_taken"], boxes, self._prepared.findings, possible=possible)
        known = (self._prepared.clock, self._prepared.heights)
        starts = {s.stream: s.start_ns for s in self._prepared.streams}
        sightings = sightings_json([*found, *possible], self._prepared.cameras, starts)
        folder = self.folder
        if shown:
            main = next(name for name, m in fuser.maps.items() if m is fuser.map)
            write_bytes(folder / MAP, layer_of(maps[main]).encoded())
            write_text(folder / SIGHTINGS, sightings)
            write_salient(folder / POSSIBLE, possible, None, *known)
            write_salient(folder / FOUND, found, None, *known)
        self.figures = self._figures(maps, len(found), len(possible)) if shown else None
        said = {
            "at": _now(),
            "places": len(found),
            "possible": len(possible),
            "verdict": {"kind": verdict.kind, "sentence": verdict.sentence, "doubts": dict(verdict.doubts)},
            "too_large": not shown,
        }
        write_text(folder / REDUCER, json.dumps(state | said, allow_nan=False) + "\n")
        self._written = key
        return True

    @staticmethod
    def _figures(maps: Mapping[str, VoxelMap], places: int, possible: int) -> MapFigures:
        first = next(iter(maps.values()))
        tiles = (first.tiles.tile(*tile)["observations"] for tile in first.tiles.touched_tiles())
        cells = sum(int(np.count_nonzero(observations)) for observations in tiles)
        return MapFigures(places, possible, cells * first.terrain.cell_m**2)

    def _copied(self, name: str, voxel_map: VoxelMap, lock: AbstractContextManager[Any]) -> VoxelMap:
        """The map as it is, or for tiles that are copied later as it is then."""
        shadow = self._shadows.get(name)
        if shadow is None:
            shadow = copy.copy(voxel_map)
            shadow.tiles = Tiles(voxel_map.tiles.shape, voxel_map.tiles.cells.dtype)
            self._shadows[name] = shadow
        for tile in list(voxel_map.tiles.touched_tiles()):
            with lock:
                shadow.tiles.tile(*tile)[:] = voxel_map.tiles.tile(*tile)
            shadow.tiles.touched[tile] = True
        return shadow


def _counts(stage: ReducerStage) -> dict[str, Any]:
    """What the reducer has counted so far, per stream and per substream."""
    streams = sorted({stream for stream, _ in stage.processed})
    newest = {stream: ns for (stream, _), ns in sorted(stage.fuser.last_ns.items())}
    return {
        "frames": {stream: len(stage.frames(stream)) for stream in streams},
        "frames_dropped": {stream: stage.frames_dropped(stream) for stream in streams},
        "results": {" ".join(key): len(frames) for key, frames in sorted(stage.processed.items())},
        "detections": {" ".join(key): count for key, count in sorted(stage.detections.items())},
        "not_taken": stage.not_taken,
        "newest_ns": newest,
    }


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")

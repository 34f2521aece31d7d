"""Where the drones of a running mission are, as Cursor-on-Target events, from the files of its ``live/``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.outputs.exports.cot import drone_event, uid_of
from pipeline.outputs.exports.view import RunView
from pipeline.outputs.live_names import LIVE, REDUCER
from pipeline.view.files import GROUND, POSES
from pipeline.view.ground import Ground
from pipeline.view.poses import Flight, decoded


class DroneEvents:
    """Of one run. What is known of its flights is read when it is written: once, and again where they are live."""

    def __init__(self, run: Path) -> None:
        self._folder = run / LIVE
        self._known: tuple[int, Ground, tuple[Flight, ...]] | None = None

    def now(self, view: RunView) -> dict[str, bytes]:
        """Events by uid: each drone where it took the newest picture that somebody has looked at; none without files.

        A redacted view has none: where a drone is says where is searched.
        """
        if view.redacted:
            return {}
        try:
            newest_ns: dict[str, Any] = json.loads((self._folder / REDUCER).read_bytes())["newest_ns"]
            stamp = (self._folder / POSES).stat().st_mtime_ns
            if self._known is None or self._known[0] != stamp:
                ground = Ground.decoded((self._folder / GROUND).read_bytes())
                self._known = stamp, ground, decoded((self._folder / POSES).read_bytes())
        except (OSError, ValueError, KeyError, TypeError):
            return {}
        _, ground, flights = self._known
        events = {}
        for flight in flights:
            if flight.stream not in newest_ns or not len(flight.times_s):
                continue
            time_s = (int(newest_ns[flight.stream]) - flight.start_ns) * 1e-9
            east, north = (np.interp(time_s, flight.times_s, flight.positions[:, k]) for k in (0, 1))
            latitude, longitude = ground.frame.wgs84_from_enu(np.array(east), np.array(north))
            uid = uid_of(view, f"drone-{flight.stream}")
            events[uid] = drone_event(view, flight.stream, float(latitude), float(longitude))
        return events

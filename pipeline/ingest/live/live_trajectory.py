"""The way of a camera while it flies: a trajectory that grows at its end."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.config.telemetry import Telemetry
from pipeline.config.uncertainty import Uncertainty
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.resolution import with_resolution
from pipeline.ingest.track import Clock, Track
from pipeline.ingest.trajectory import Trajectory
from pipeline.ingest.trajectory_of import Ground, trajectory_of
from pipeline.messages import CameraPose, FloatArray

#: columns of a way: time, position (3), angles (3), standard deviations (3), focal scale
WAY_COLUMNS = 11
#: samples that may still change by those after them, seconds
_SETTLED_S = 1.0


@dataclass(frozen=True, eq=False)
class WayRecipe:
    """How telemetry becomes the camera's way, as for a file (``trajectory_of``)."""

    telemetry: Telemetry
    frame: LocalFrame
    ground: Ground
    uncertainty: Uncertainty
    focal_reference_mm: float | None

    def trajectory(self, track: Track) -> Trajectory:
        """track: on the stream's clock. Raises InputError if no sample of it can be used."""
        way = trajectory_of(
            track,
            self.telemetry,
            self.frame,
            self.ground,
            offset_s=0.0,
            uncertainty=self.uncertainty,
            focal_reference_mm=self.focal_reference_mm,
        )
        return with_resolution(way, track, self.telemetry)[0]


class LiveTrajectory:
    """As a Trajectory to whoever asks for a pose; ``extend`` lets it grow, from another thread.

    begin: what was known when the mission was prepared; that travels, what was learnt since does not. Poses may be
    asked for the newest samples: a time before them is of a picture that was given up.
    """

    def __init__(self, begin: Trajectory, recipe: WayRecipe) -> None:
        self._begin, self._recipe = begin, recipe
        self._forget()

    def _forget(self) -> None:
        self._now, self._grown = self._begin, threading.Condition()
        self._rows: list[FloatArray] = []
        self._settled_s = -math.inf
        self.fault = ""

    def __getstate__(self) -> dict[str, Any]:
        return {"begin": self._begin, "recipe": self._recipe}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._begin, self._recipe = state["begin"], state["recipe"]
        self._forget()

    # --- as a Trajectory

    @property
    def newest(self) -> Trajectory:
        """The newest samples."""
        return self._now

    @property
    def start_ns(self) -> int:
        """Date of the stream's time 0, ns since 1970, UTC."""
        return self._begin.start_ns

    @property
    def clock(self) -> Clock:
        """UTC, by the stream's stamps or by this machine's clock."""
        return self._begin.clock

    @property
    def takeoff_m(self) -> float:
        """As of a Trajectory."""
        return self._begin.takeoff_m

    @property
    def assumed(self) -> tuple[str, ...]:
        """As of a Trajectory."""
        return self._begin.assumed

    @property
    def times_s(self) -> FloatArray:
        """Of the newest samples."""
        return self._now.times_s

    @property
    def positions_enu(self) -> FloatArray:
        """Of the newest samples."""
        return self._now.positions_enu

    @property
    def angles_rad(self) -> FloatArray:
        """Of the newest samples."""
        return self._now.angles_rad

    @property
    def span_s(self) -> tuple[float, float]:
        """Of the newest samples."""
        return self._now.span_s

    def utc_ns(self, time_s: float) -> int:
        """As of a Trajectory."""
        return self._begin.utc_ns(time_s)

    def pose(self, time_s: float) -> CameraPose | None:
        """As of a Trajectory."""
        return self._now.pose(time_s)

    def covers(self, times_s: FloatArray) -> NDArray[np.bool_]:
        """As of a Trajectory."""
        return self._now.covers(times_s)

    # --- while it flies

    def extend(self, track: Track) -> None:
        """The newest samples, a window that overlaps the one before it; times on the stream's clock."""
        try:
            newest = self._recipe.trajectory(track)
        except InputError as error:  # no fix, or no angle, for as long as the window
            self.fault = f"{error.found}"
            return
        newest = replace(newest, start_ns=self._begin.start_ns, clock=self._begin.clock)
        self.fault = ""
        with self._grown:
            self._keep(newest, _SETTLED_S)
            self._now = newest
            self._grown.notify_all()

    def wait_until_known(self, time_s: float, most_s: float) -> bool:
        """Wait, at most so long, until there is a sample at a time or after it; whether there is."""
        with self._grown:
            return self._grown.wait_for(lambda: float(self._now.times_s[-1]) >= time_s, max(0.0, most_s))

    def take_rows(self, *, all_of_it: bool = False) -> FloatArray:
        """The samples that were settled since the last call, (N, WAY_COLUMNS); all_of_it: the newest ones too."""
        with self._grown:
            if all_of_it:
                self._keep(self._now, 0.0)
            rows, self._rows = self._rows, []
        return np.concatenate(rows) if rows else np.zeros((0, WAY_COLUMNS))

    def _keep(self, newest: Trajectory, settled_s: float) -> None:
        times = newest.times_s
        new = (times > self._settled_s) & (times <= float(times[-1]) - settled_s)
        if new.any():
            self._rows.append(rows_of(newest)[new])
            self._settled_s = float(times[new][-1])

    def flown(self, rows: FloatArray) -> Trajectory:
        """The whole way, once it is flown. rows: of take_rows, in order; without any, what was known at the start."""
        return with_rows(self._begin, rows) if len(rows) else self._begin


def rows_of(way: Trajectory) -> FloatArray:
    """Its samples, (N, WAY_COLUMNS)."""
    return np.column_stack([way.times_s, way.positions_enu, way.angles_rad, way.sds, way.focal_scale])


def with_rows(way: Trajectory, rows: FloatArray) -> Trajectory:
    """The same with other samples. rows: (N, WAY_COLUMNS), N >= 1, of several processes perhaps; later ones count."""
    times, last = np.unique(rows[::-1, 0], return_index=True)
    ordered = rows[::-1][last]
    half_s = 0.5 * float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    return replace(
        way,
        times_s=times,
        positions_enu=ordered[:, 1:4],
        angles_rad=ordered[:, 4:7],
        sds=ordered[:, 7:10],
        focal_scale=ordered[:, 10],
        end_s=float(times[-1]) + half_s,
    )

"""The map of one object class: what is known of every voxel, one voxel per cell of the terrain's surface."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.fusion.footprint import NO_FOOTPRINTS, Footprints
from pipeline.fusion.look_kernels import POD_STEPS, RESOLUTION_STEPS
from pipeline.fusion.tiles import Tiles, Window
from pipeline.fusion.voxel_map_kernels import add_clamped, observe
from pipeline.geo.terrain import Terrain
from pipeline.messages import FloatArray
from pipeline.sensor.model import SensorModel

#: Probabilities are kept this far from 0 and 1, so that every log-odds is finite.
_CERTAINTY = 1e-9

#: Frames that follow one another within this time are one look, nanoseconds.
LOOK_GAP_NS = 1_000_000_000

_NOT_KNOWN = np.zeros(0)
_NONE = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.float32)

#: What is kept of a voxel, 32 bytes; all zero where nothing is known. pod_before: POD of the looks that are over;
#: pod_look: the best frame's of the look that had the newest frame, from viewpoint. other, other_pod, other_age: of one
#: more look that is open, see ``look_kernels``. resolution_px: in sixteenths of a pixel.
VOXEL = np.dtype(
    [
        ("log_odds", "<f4"),
        ("observations", "<i4"),
        ("pod_before", "<f4"),
        ("pod_look", "<f4"),
        ("last_seen_ns", "<i8"),
        ("looks", "<u2"),
        ("resolution_px", "<u2"),
        ("viewpoint", "u1"),
        ("other", "u1"),
        ("other_pod", "u1"),
        ("other_age", "u1"),
    ]
)


def log_odds(probability: FloatArray) -> FloatArray:
    """L = log(p / (1 - p)) of probabilities in 0..1, any shape; finite at 0 and 1."""
    p = np.clip(probability, _CERTAINTY, 1.0 - _CERTAINTY)
    return np.asarray(np.log(p / (1.0 - p)), dtype=np.float64)


class VoxelMap:
    """Evidence on the surface cells of a terrain, and how well each was observed.

    Layers, each (rows, columns), row 0 the south edge; as properties they are copies of the whole, ``layer``
    gives a part:

    - log_odds: float32, OctoMap's additive evidence with clamping; 0 where nothing is known.
    - observations: int32, number of updates.
    - looks: int32, how often it was looked at, up to 65,535. Frames of one viewpoint that follow one another within
      LOOK_GAP_NS are one look: what hides a person from one of them hides the person from the next. Two drones that
      see it at once are two looks.
    - resolution_px: float32, to a sixteenth, greatest height in pixels at which a person of PERSON_HEIGHT_M
      showed; 0: never.
    - pod: float32 0..1, probability of detection of an object of the class had one been there: 1 - prod(1 -
      POD of a look), and a look is as good as its best frame; where the probability of being found is known, each
      frame is as much of a look of its own as its share says. Under cover (``Terrain.cover``) it is that of people
      who are not hidden times their share.
    - last_seen_ns: int64, capture time, ns UTC; 0: never.

    The result of a series of updates depends on their order, because each is clamped.
    """

    def __init__(
        self,
        terrain: Terrain,
        clamp_min: float,
        clamp_max: float,
        folder: Path | None = None,
        owned: NDArray[np.bool_] | None = None,
    ) -> None:
        """clamp_min, clamp_max: least, greatest probability of a voxel; InputError unless 0.5 is between.

        folder: where the map may put what does not fit into memory. owned: the tiles that are kept, the rest
        is never written to; all if absent.
        """
        if not 0.0 <= clamp_min < 0.5 < clamp_max <= 1.0:
            raise InputError(
                "fusion.clamp_min, clamp_max", f"{clamp_min:g} and {clamp_max:g}", "0 <= min < 0.5 < max <= 1"
            )
        self.terrain = terrain
        self.tiles = Tiles(terrain.shape, VOXEL, folder, owned)
        low, high = log_odds(np.array([clamp_min, clamp_max]))
        #: least and greatest log-odds
        self.limits = float(low), float(high)

    @property
    def log_odds(self) -> NDArray[np.float32]:
        """See the class."""
        return self.layer("log_odds")

    @property
    def observations(self) -> NDArray[np.int32]:
        """See the class."""
        return self.layer("observations")

    @property
    def looks(self) -> NDArray[np.int32]:
        """See the class."""
        return self.layer("looks")

    @property
    def resolution_px(self) -> NDArray[np.float32]:
        """See the class."""
        return self.layer("resolution_px")

    @property
    def pod(self) -> NDArray[np.float32]:
        """See the class."""
        return self.layer("pod")

    @property
    def last_seen_ns(self) -> NDArray[np.int64]:
        """See the class."""
        return self.layer("last_seen_ns")

    def layer(self, name: str, window: Window = (slice(None), slice(None))) -> NDArray[Any]:
        """A part (rows, columns) of a layer; a copy. name: see the class."""
        part: NDArray[Any]
        if name == "pod":
            before, look = self.tiles.part("pod_before", window), self.tiles.part("pod_look", window)
            other = self.tiles.part("other_pod", window).astype(np.float32) / np.float32(POD_STEPS)
            part = 1.0 - (1.0 - before) * (1.0 - look) * (1.0 - other)
            hidden = self._hidden(window)
            part = part if hidden is None else part * (1.0 - hidden)
        elif name == "looks":
            part = self.tiles.part(name, window).astype(np.int32)
        elif name == "resolution_px":
            part = self.tiles.part(name, window).astype(np.float32) / np.float32(RESOLUTION_STEPS)
        else:
            part = self.tiles.part(name, window)
        part.flags.writeable = False  # a copy: what is written to it would be lost
        return part

    def probability(self, window: Window = (slice(None), slice(None))) -> NDArray[np.float32]:
        """float32 (rows, columns) in 0..1; 0.5 where nothing is known, NaN where there is no voxel.

        Under cover, looks that found nothing say nothing of those who are hidden: with a share h of them, what the
        looks left of the odds is h + (1 - h) of what they would have left. Who was seen is not hidden.
        """
        log_odds, hidden = self.layer("log_odds", window), self._hidden(window)
        if hidden is not None:
            left = np.log(np.maximum(hidden + (1.0 - hidden) * np.exp(log_odds), _CERTAINTY))
            log_odds = np.where(log_odds < 0.0, left, log_odds)
        known = 1.0 / (1.0 + np.exp(-log_odds))
        return np.where(np.isfinite(self.terrain.heights_m[window]), known, np.float32(np.nan)).astype(
            np.float32
        )

    def touched_window(self) -> Window:
        """The least part of the map that holds all that is known, in whole tiles; empty if nothing is."""
        return self.tiles.touched_window()

    def probable(self, threshold: float) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
        """Rows, columns and probabilities (N,) of the observed voxels above a threshold, row by row."""
        found = []
        for tile in self.tiles.touched_tiles():
            window = self.tiles.window(*tile)
            p, observed = self.probability(window), self.layer("observations", window) > 0
            rows, columns = np.nonzero((p > threshold) & observed)
            found.append((rows + window[0].start, columns + window[1].start, p[rows, columns]))
        rows, columns, p = (np.concatenate(part) for part in zip(_NONE, *found, strict=True))
        order = np.lexsort((columns, rows))
        return rows[order], columns[order], p[order]

    def cells_of(self, name: str, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[Any]:
        """A field of VOXEL at cells (N,) that were touched: (N,)."""
        return np.asarray(self.tiles.cells[name][self.tiles.flat(rows, columns)])

    def end_looks(self) -> None:
        """Let every look be over: the next frame of a cell begins another one."""
        for tile in self.tiles.touched_tiles():
            cells = self.tiles.tile(*tile)
            missed = (1.0 - cells["pod_before"]) * (1.0 - cells["pod_look"])
            cells["pod_before"] = 1.0 - missed * (1.0 - cells["other_pod"] / np.float32(POD_STEPS))
            for name in ("pod_look", "viewpoint", "other", "other_pod", "other_age"):
                cells[name] = 0

    def valid(self, row: int, column: int) -> bool:
        """Whether there is a voxel: a cell of the terrain whose height is known."""
        rows, columns = self.terrain.shape
        inside = 0 <= row < rows and 0 <= column < columns
        return inside and math.isfinite(self.terrain.heights_m[row, column])

    def update(self, rows: NDArray[np.int64], columns: NDArray[np.int64], delta: FloatArray) -> None:
        """L(n|z_1:t) = L(n|z_1:t-1) + L(n|z_t), clamped (eq:voxelloupdate).

        rows, columns: int64 (N,), valid cells. delta: float64 (N,) log-odds. A cell named twice is updated
        twice, in order.
        """
        self._keep(np.stack([rows, columns]))
        self.tiles.touch(rows, columns)
        add_clamped(self.tiles.cells, self.tiles.flat(rows, columns), delta, *self.limits)

    def observe(
        self,
        seen: NDArray[np.int32],
        distances_m: FloatArray,
        raised: NDArray[np.int64],
        raised_distances_m: FloatArray,
        model: SensorModel,
        p_detector: float,
        time_ns: int,
        wide: Footprints = NO_FOOTPRINTS,
        share: float = 1.0,
        found: FloatArray | None = None,
        viewpoint: int = 1,
    ) -> None:
        """Lower the voxels that a frame saw, raise those of its wide looks, and note how well it saw all of them.

        seen: int32 (2, N) rows and columns, each voxel once. distances_m: float64 (N,) from the camera;
        voxels beyond the model's greatest distance are left alone. raised: int64 (2, M) rows and columns of the
        looks' points. wide: the looks that have a width; if there is none, raised have been raised, and are not
        lowered. share: of the frame's evidence that counts, 0..1. found: float64 (K,), the probability that an
        object of the class is found at K equal steps from no distance to the model's greatest; absent: the paper's
        distance factor, with p_detector. viewpoint: 1..255, of the frame, see ``Viewpoints``.
        """
        self._keep(seen, raised, wide.windows[:, :2].T, wide.windows[:, :2].T + wide.windows[:, 2:].T - 1)
        observe(
            self.tiles.cells,
            self.tiles.owned,
            self.tiles.touched,
            seen,
            distances_m,
            raised,
            raised_distances_m,
            (wide.windows, wide.starts, wide.raised, wide.shielded, wide.odds),
            (
                model.negative_max * (p_detector if found is None else 1.0),
                model.frame_pod(0.0, p_detector),
                share,
            ),
            _NOT_KNOWN if found is None else found,
            (model.max_distance_m, model.resolution_px_m),
            (time_ns, LOOK_GAP_NS, viewpoint),
            self.limits,
        )

    def _hidden(self, window: Window) -> NDArray[np.float32] | None:
        """Of people in a part of the map the share that is hidden; None if there is no cover."""
        return None if self.terrain.cover is None else self.terrain.cover[window]

    def _keep(self, *cells: NDArray[Any]) -> None:
        """Before a frame writes to some of the cells, rows and columns (2, N), or between them."""
        if self.tiles.before is None:
            return
        ends = [(part.min(axis=1), part.max(axis=1)) for part in cells if part.shape[1]]
        if ends:
            low, high = np.min([a for a, _ in ends], axis=0), np.max([b for _, b in ends], axis=0)
            self.tiles.keep((int(low[0]), int(low[1])), (int(high[0]), int(high[1])))

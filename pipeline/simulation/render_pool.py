"""Rendering on all cores, in order, with no more pictures in memory than the encoder can soon take."""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Iterator
from multiprocessing.pool import AsyncResult, Pool

import numpy as np

from pipeline.config.scenario import Scenario
from pipeline.simulation.person import Person
from pipeline.simulation.rehearsal import Rehearsal, rehearse
from pipeline.simulation.renderer import Picture, Renderer

_SENSOR_STREAM = 5
#: pictures under way for each worker: one in work, and some that wait
_AHEAD = 3

_worker: FrameRenderer | None = None


class FrameRenderer:
    """Renders any frame of any drone; what it draws depends on nothing else."""

    def __init__(self, rehearsal: Rehearsal) -> None:
        self._rehearsal = rehearsal
        self._renderer = Renderer(rehearsal.scene, rehearsal.camera)

    def __call__(self, drone: int, index: int) -> Picture:
        """One picture."""
        flight = self._rehearsal.flights[drone]
        rng = np.random.default_rng([self._rehearsal.scenario.seed, _SENSOR_STREAM, drone, index])
        return self._renderer.render(flight.pose(index), float(flight.times_s[index]), rng)


class RenderPool:
    """Processes that render a rehearsal's frames; a context manager. One worker renders in this process."""

    def __init__(self, rehearsal: Rehearsal, workers: int) -> None:
        self._rehearsal, self._workers = rehearsal, workers
        self._pool: Pool | None = None

    def __enter__(self) -> RenderPool:
        if self._workers > 1:
            # a forked child would inherit Embree's threads in an unknown state
            known = (self._rehearsal.scenario, self._rehearsal.scene.people)
            self._pool = multiprocessing.get_context("spawn").Pool(self._workers, _start, known)
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.terminate()
            self._pool.join()

    def pictures(self, drone: int) -> Iterator[Picture]:
        """All pictures of a drone's flight, in order."""
        indices = range(len(self._rehearsal.flights[drone].times_s))
        if self._pool is None:
            renderer = FrameRenderer(self._rehearsal)
            yield from (renderer(drone, index) for index in indices)
            return
        waiting: deque[AsyncResult[Picture]] = deque()
        for index in indices:
            waiting.append(self._pool.apply_async(_render, (drone, index)))
            if len(waiting) >= _AHEAD * self._workers:
                yield waiting.popleft().get()
        while waiting:
            yield waiting.popleft().get()


def _start(scenario: Scenario, people: tuple[Person, ...]) -> None:
    global _worker  # noqa: PLW0603 - a pool's workers have no other place to keep what all their tasks need
    _worker = FrameRenderer(rehearse(scenario, people))


def _render(drone: int, index: int) -> Picture:
    assert _worker is not None
    return _worker(drone, index)

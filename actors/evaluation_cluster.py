"""The grid's units on a Ray cluster: one task for each, on one core."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from actors.cluster import cluster
from pipeline.evaluation.measuring.grid import Execute
from pipeline.evaluation.measuring.work_unit import Unit, UnitResult, work


def on_cluster(address: str | None) -> Execute:
    """Units run wherever the cluster has a free core; videos and models lie there under the same paths.

    address: of the head; None: a Ray of this machine, for this evaluation alone. Encoded streams are not
    kept: the nodes share no folder with us.
    """
    return partial(_on_cluster, address)


def _on_cluster(address: str | None, units: list[Unit]) -> Iterator[tuple[Unit, UnitResult]]:
    with cluster(address, ()):
        import ray

        task = ray.remote(num_cpus=1, max_retries=3)(work)
        waiting = {task.remote(replace(unit, packets=None)): unit for unit in units}
        while waiting:
            (done, *_), _ = ray.wait(list(waiting), num_returns=1)
            yield waiting.pop(done), _result(done)


def _result(reference: Any) -> UnitResult:
    import ray

    try:
        result: UnitResult = ray.get(reference)
    except ray.exceptions.RayTaskError as error:
        raise error.cause if isinstance(error.cause, Exception) else error from None
    return result

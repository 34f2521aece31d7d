"""The grid's units on a Ray cluster: one task for each bundle of them, on one core."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from actors.cluster import cluster
from pipeline.evaluation.measuring.bundles import bundles
from pipeline.evaluation.measuring.grid import Execute
from pipeline.evaluation.measuring.unit import Unit
from pipeline.evaluation.measuring.work_unit import UnitResult, work


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
        workers = max(1, int(_resources(ray).get("CPU", 1)))
        todo = bundles([replace(unit, packets=None) for unit in units], workers)
        asked = {(unit.sequence, unit.condition): unit for unit in units}
        waiting = {task.remote(bundle): bundle for bundle in todo}
        while waiting:
            (done, *_), _ = ray.wait(list(waiting), num_returns=1)
            for unit, result in zip(waiting.pop(done), _results(done), strict=True):
                yield asked[unit.sequence, unit.condition], result


def _resources(ray: Any) -> dict[str, float]:
    return dict(ray.cluster_resources())


def _results(reference: Any) -> tuple[UnitResult, ...]:
    import ray

    try:
        results: tuple[UnitResult, ...] = ray.get(reference)
    except ray.exceptions.RayTaskError as error:
        raise error.cause if isinstance(error.cause, Exception) else error from None
    return results

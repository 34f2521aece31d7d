"""The grid's units on a Ray cluster: one task for each, on one core."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import ray

from pipeline.errors import InputError
from pipeline.evaluation.grid import Execute
from pipeline.evaluation.unit import Unit, UnitResult, work


def on_cluster(address: str) -> Execute:
    """Units run wherever the cluster has a free core; videos and models lie there under the same paths.

    Encoded streams are not kept: the nodes share no folder with us.
    """
    return partial(_on_cluster, address)


def _on_cluster(address: str, units: list[Unit]) -> Iterator[tuple[Unit, UnitResult]]:
    try:
        ray.init(address=address, log_to_driver=False, logging_level="error")
    except (ConnectionError, ValueError, RuntimeError) as error:
        reason = str(error).splitlines()[0][:120]
        raise InputError(
            "--address", f"{address}, where no cluster answers ({reason})", "HOST:PORT of a Ray head"
        ) from None
    try:
        task: Any = ray.remote(num_cpus=1, max_retries=3)(work)
        waiting = {task.remote(replace(unit, packets=None)): unit for unit in units}
        while waiting:
            done, _ = ray.wait(list(waiting), num_returns=1)
            for reference in done:
                yield waiting.pop(reference), _result(reference)
    finally:
        ray.shutdown()


def _result(reference: Any) -> UnitResult:
    try:
        return ray.get(reference)  # type: ignore[no-any-return]
    except ray.exceptions.RayTaskError as error:
        raise error.cause if isinstance(error.cause, Exception) else error from None

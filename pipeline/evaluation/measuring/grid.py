"""The grid of conditions: what there is to do, what is done already, and doing the rest."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import partial

from pipeline.config.evaluation import Evaluation
from pipeline.errors import InputError, RunFailedError
from pipeline.evaluation.datasets.dataset import DataSet, Sequence, kept_frames, sampled_pictures
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.evaluation.measuring.bundles import Bundle, bundles, cost
from pipeline.evaluation.measuring.cache import Cache
from pipeline.evaluation.measuring.unit import Condition, Model, Unit
from pipeline.evaluation.measuring.work_unit import UnitResult, work
from pipeline.link.codec import available_codecs

#: runs units somewhere and yields them with their results as they are finished
Execute = Callable[[list[Unit]], Iterator[tuple[Unit, UnitResult]]]
#: name of what is under way, done, in all, a note
Progress = Callable[[str, int, int, str], None]


@dataclass(frozen=True, eq=False)
class Grid:
    """conditions: that can be measured. missing_codecs: asked for, but this build of FFmpeg lacks them."""

    units: tuple[Unit, ...]
    conditions: tuple[Condition, ...]
    missing_codecs: tuple[str, ...]


def plan_grid(evaluation: Evaluation, dataset: DataSet, models: tuple[Model, ...]) -> Grid:
    """Every sequence under every condition; the first condition is the pictures as they are.

    Raises InputError if the pool's codec is missing, and for sequences that cannot be transcoded.
    """
    asked = evaluation.transcoding
    missing: tuple[str, ...] = ()
    conditions = [Condition()]
    if asked is not None:
        missing = tuple(codec for codec in asked.codecs if codec not in available_codecs())
        if evaluation.pool.codec in missing:
            have = ", ".join(available_codecs())
            raise InputError("pool.codec", f"{evaluation.pool.codec}, which this build of FFmpeg lacks", have)
        conditions += [
            Condition(codec, bitrate)
            for codec in asked.codecs
            if codec not in missing
            for bitrate in sorted(asked.bitrates)
        ]
    units = [u for q in dataset.sequences for u in _units(evaluation, dataset, q, models, conditions)]
    return Grid(tuple(units), tuple(conditions), missing)


def _units(
    evaluation: Evaluation,
    dataset: DataSet,
    sequence: Sequence,
    models: tuple[Model, ...],
    conditions: list[Condition],
) -> Iterator[Unit]:
    asked = evaluation.transcoding
    if asked is None:
        kept = tuple(range(sequence.frames))
        looked = sampled_pictures(dataset, sequence, evaluation.sample_rate)
        rate_hz = sequence.frame_rate or 1.0
    else:
        indices = kept_frames(sequence, asked.frame_rate)
        kept = tuple(int(i) for i in indices)
        looked = sampled_pictures(dataset, sequence, evaluation.sample_rate, indices)
        rate_hz = min(asked.frame_rate, sequence.frame_rate or asked.frame_rate)
    for condition in conditions:
        yield Unit(
            sequence=sequence.name,
            files=sequence.files,
            is_video=sequence.is_video,
            frame_rate_hz=rate_hz,
            kept=kept,
            looked={dataset.pictures[n].frame: n for n in looked},
            size=None if asked is None else (asked.width, asked.height),
            condition=condition,
            keyframe_interval=1 if asked is None else max(1, round(asked.keyframe_interval * rate_hz)),
            models=models,
            score_cutoff=evaluation.score_cutoff,
        )


def run_grid(
    grid: Grid,
    dataset: DataSet,
    cache: Cache,
    faults: FaultLog,
    execute: Execute,
    progress: Progress,
    keep_streams: bool = False,
    spent: dict[str, float] | None = None,
) -> dict[tuple[str, Condition], UnitResult]:
    """The results by sequence and condition, from the cache or worked out and put there.

    keep_streams: encoded streams too, for detectors to come. spent: takes the seconds that were worked now.
    Each is in the cache before the next one is waited for: an interrupted run loses only what is under way.
    Raises InputError if a detector returns what is not finite and that is refused.
    """
    source = {q.name: q.sha256 for q in dataset.sequences}
    results: dict[tuple[str, Condition], UnitResult] = {}
    todo: list[Unit] = []
    for unit in grid.units:
        known = [(m, cache.load(unit, source[unit.sequence], m)) for m in unit.models]
        for model, result in known:
            if result is not None:
                _take(results, unit, result, (model,), faults)
        absent = tuple(m for m, result in known if result is None)
        if absent:
            packets = (
                cache.packets(unit, source[unit.sequence]) if keep_streams and unit.condition.codec else None
            )
            todo.append(replace(unit, models=absent, packets=packets))
    total, done = sum(map(cost, grid.units)), sum(map(cost, grid.units)) - sum(map(cost, todo))
    progress("grid", done, total, f"{len(todo)} of {len(grid.units)} to do")
    left = len(todo)
    for unit, result in execute(todo) if todo else ():
        cache.store(unit, source[unit.sequence], result)
        _take(results, unit, result, unit.models, faults)
        for part, seconds in result.seconds.items():
            if spent is not None:
                spent[part] = spent.get(part, 0.0) + seconds
        done, left = done + cost(unit), left - 1
        progress("grid", done, total, f"{left} of {len(grid.units)} to do")
    return results


def _take(
    results: dict[tuple[str, Condition], UnitResult],
    unit: Unit,
    result: UnitResult,
    models: tuple[Model, ...],
    faults: FaultLog,
) -> None:
    for model in models:
        count = result.found[model.id].not_finite
        if count:
            where = f"{model.path} on {unit.sequence}, {unit.condition}"
            faults.report(
                "not_finite", where, f"{count} detections that are NaN or infinite", "numbers", count
            )
    key = unit.sequence, unit.condition
    known = results.get(key)
    results[key] = result if known is None else replace(result, found=known.found | result.found)


def in_processes(workers: int) -> Execute:
    """Units run in so many processes of this machine, each bundle of them in one thread."""
    return partial(_in_processes, workers)


def _in_processes(workers: int, units: list[Unit]) -> Iterator[tuple[Unit, UnitResult]]:
    todo = bundles(units, workers)
    if workers == 1:
        for bundle in todo:
            yield from zip(bundle, work(bundle), strict=True)
        return
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, context, initializer=_obey_the_parent)
    try:
        waiting: dict[Future[tuple[UnitResult, ...]], Bundle] = {pool.submit(work, b): b for b in todo}
        while waiting:
            finished, _ = wait(waiting, return_when=FIRST_COMPLETED)
            for future in finished:
                yield from zip(waiting.pop(future), future.result(), strict=True)
    except BrokenProcessPool:
        raise RunFailedError(
            "a process of the grid died, perhaps for lack of memory: try fewer --workers"
        ) from None
    except BaseException:
        # what is under way is lost anyway: end it now, not in minutes
        for process in list(getattr(pool, "_processes", {}).values()):
            with contextlib.suppress(OSError):
                process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _obey_the_parent() -> None:
    """Interrupts are the parent's to handle; when it dies, whatever the way, its workers end too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

"""``searchlight detector add``: a pool with one detector, measured here."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from actors.commands.detector_options import (
    InputSize,
    LayoutOption,
    Model,
    Names,
    Overlap,
    Person,
    Provider,
    Threads,
    Tiles,
    Whole,
    pair,
    print_reading,
    reading_of,
    require_file,
)
from actors.commands.tiling_cost import FRAME_4K, say_tiling
from actors.terminal import progress_bars, say
from pipeline.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from pipeline.detection import Reading


def add(
    file: Model,
    out: Annotated[Path, typer.Option(help="The pool file to write; must not exist.")],
    machine: Annotated[str, typer.Option(help="Name of this machine's type, as inventories have it.")],
    labels: Annotated[
        Path | None, typer.Option(help="COCO JSON of labelled stills, or of frames of videos (VIDEO#FRAME).")
    ] = None,
    pictures: Annotated[Path | None, typer.Option(help="Folder that the labels' file names are in.")] = None,
    assume_like: Annotated[
        str | None, typer.Option(help="No labels: accuracy as that of this detector of --pool.")
    ] = None,
    pool: Annotated[Path | None, typer.Option(help="The pool for --assume-like.")] = None,
    name: Annotated[str | None, typer.Option(help="Its id in the pool; by default the file's name.")] = None,
    layout: LayoutOption = None,
    names: Names = None,
    person: Person = None,
    tiles: Tiles = None,
    overlap: Overlap = 0.2,
    whole: Whole = False,
    input_size: InputSize = None,
    threads: Threads = 1,
    provider: Provider = "cpu",
    timed_size: Annotated[
        str, typer.Option(help="WIDTHxHEIGHT of the pictures that it is timed on.")
    ] = "1920x1080",
) -> None:
    """A pool with this detector: accuracy by size and calibration from labels, times on this machine."""
    from pipeline.config.evaluation import Setup
    from pipeline.detection.crash_test import require_survivable
    from pipeline.evaluation.pool.detector_row import NewDetector, assumed_row, measured_row, timed, write_row

    if (labels is None) == (assume_like is None):
        found = "neither" if labels is None else "both"
        raise InputError("--labels, --assume-like", found, "one of both")
    if out.exists():
        raise InputError(out, "a file that is there already", "a new name")
    require_file(file)
    require_survivable(file)
    reading = reading_of(layout, names, person, tiles, overlap, whole, input_size)
    setup = Setup(machine=machine, provider=provider, threads=threads)
    new = NewDetector(name or file.stem, file, reading, setup)
    like = None if assume_like is None else _pool_detector(pool, assume_like)
    result = None if labels is None else _measured(file, reading, labels, pictures, setup)
    width, height = pair(timed_size, "--timed-size") or (1920, 1080)
    timing = timed(new, [_noise(width, height)], lambda part: say(f"timing: {part}"))
    if result is not None:
        row = measured_row(new, result, timing, out)
        accuracy = f"AP .5 on {result.pictures} labelled pictures with {result.people} people, as they are"
    else:
        assert like is not None
        row = assumed_row(new, like, timing, out)
        accuracy = f"assumed as that of {like.id} in {pool}"
    where = f"pictures of {width} x {height}"
    write_row(out, row, {"accuracy": accuracy, "times": where, "command": "searchlight detector add"})
    say(f"times: mean {1e3 * timing.mean_s:.1f} ms, maximum {1e3 * timing.maximum_s:.1f} ms on {where}")
    if reading.tiling is not None:
        on_4k = timed(new, [_noise(*FRAME_4K)], lambda part: say(f"timing on 4K: {part}"), sharing=())
        say_tiling(reading.tiling, on_4k.mean_s, on_4k.memory_bytes)
    say(f"assumed: {row['assumed']}")
    say(f"pool: {out}")


def _noise(width: int, height: int) -> NDArray[np.uint8]:
    import numpy as np

    return np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)


def _measured(file: Path, reading: Reading, labels: Path, pictures: Path | None, setup: Any) -> Any:
    from pipeline.config.evaluation import FaultPolicy
    from pipeline.detection import load_as
    from pipeline.evaluation.datasets.fault_log import FaultLog
    from pipeline.evaluation.labelled import SCORE_CUTOFF, labelled_pictures, measure_pictures

    faults = FaultLog(FaultPolicy(**dict.fromkeys(FaultPolicy.model_fields, "skip")))
    dataset = labelled_pictures(labels, pictures, faults)
    detector = load_as(
        file, reading, score_threshold=SCORE_CUTOFF, threads=setup.threads, provider=setup.provider
    )
    print_reading(detector)
    with progress_bars("pictures") as progress:
        result = measure_pictures(detector, dataset, faults, lambda done, of: progress("looking", done, of))
    for line in result.faults:
        say(line)
    for size, figures in result.by_size.items():
        if figures.people and figures.ap50 is not None:
            say(f"AP .5 {figures.ap50:.3f} of {figures.people} people ({size})")
    say(f"threshold {result.threshold:.2f}")
    if result.calibration is not None and result.error_calibrated is not None:
        say(
            "expected calibration error on the half that it was not fitted to: "
            f"{result.error:.3f} as the network says, {result.error_calibrated:.3f} calibrated"
        )
    if result.not_finite:
        say(f"{result.not_finite} boxes were not finite")
    return result


def _pool_detector(pool: Path | None, name: str) -> Any:
    from pipeline.config.pool import load_pool

    if pool is None:
        raise InputError("--pool", "nothing", f"the pool that has {name}")
    known = {d.id: d for d in load_pool(pool).detectors}
    if name not in known:
        raise InputError("--assume-like", repr(name), f"a detector of {pool}: {', '.join(known)}")
    return known[name]

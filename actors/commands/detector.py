"""``searchlight detector``: what a network is read as, what it finds, and a row of a pool for it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from actors.terminal import progress_bars, say
from pipeline.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from pipeline.detection import Detector, Reading

app = typer.Typer(no_args_is_help=True, help="Look at a detector, try it, add it to a pool.")

Model = Annotated[Path, typer.Argument(help="The detector, an ONNX file.")]
LayoutOption = Annotated[
    str | None, typer.Option(help="Name of a layout, or a YAML file with a layout: section.")
]
Names = Annotated[str | None, typer.Option(help="Its classes in order, with commas; or coco, coco91.")]
Person = Annotated[str | None, typer.Option(help="Which of its classes are persons, with commas.")]
Tiles = Annotated[
    str | None, typer.Option(help="WIDTHxHEIGHT of tiles in pixels of the picture, such as 640x640.")
]
Overlap = Annotated[
    float, typer.Option(min=0.0, max=0.9, help="Share of a tile that its neighbour sees too.")
]
Whole = Annotated[bool, typer.Option("--whole", help="And one pass over the whole picture.")]
InputSize = Annotated[str | None, typer.Option(help="WIDTHxHEIGHT, for a network that leaves it free.")]
Threads = Annotated[int, typer.Option(min=1, max=256, help="Threads of the processor.")]
Provider = Annotated[str, typer.Option(help="cpu or cuda.")]
Score = Annotated[float, typer.Option(min=0.0, max=1.0, help="Boxes below this score are left out.")]


@app.command()
def inspect(file: Model, layout: LayoutOption = None, names: Names = None, person: Person = None) -> None:
    """What a detector is read as, and why; what was assumed; its layout as a pool would describe it."""
    from pipeline.detection.crash_test import require_survivable
    from pipeline.detection.recognition import layout_yaml

    _require_file(file)
    require_survivable(file)
    detector = _opened(file, _reading(layout, names, person, None, 0.2, False, None), 0.3)
    found = detector.recognised
    assert found is not None
    size = f"{found.facts.width} x {found.facts.height}" if found.facts.size else "the picture's"
    typer.echo(f"{file}: {found.name}")
    typer.echo(f"{found.facts.signature}")
    typer.echo(f"input: {size}, from {found.facts.size_from}")
    typer.echo(
        f"classes: {len(found.names)}: {', '.join(found.names[:12])}{' ..' if len(found.names) > 12 else ''}"
    )
    for sentence in found.why:
        typer.echo(f"why: {sentence}")
    for sentence in found.assumed:
        typer.echo(f"assumed: {sentence}")
    typer.echo(layout_yaml(found.layout))


@app.command(name="try")
def try_detector(
    file: Model,
    source: Annotated[Path, typer.Argument(help="A picture, or a video.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Where boxes are drawn: PNG or MP4; beside the model's name if absent."),
    ] = None,
    score: Score = 0.3,
    layout: LayoutOption = None,
    names: Names = None,
    person: Person = None,
    tiles: Tiles = None,
    overlap: Overlap = 0.2,
    whole: Whole = False,
    input_size: InputSize = None,
    pictures: Annotated[int, typer.Option(min=1, help="Pictures of a video, at most.")] = 300,
) -> None:
    """Look at a picture or a video, and draw what is found."""
    from pipeline.detection.crash_test import require_survivable

    _require_file(file)
    require_survivable(file)
    detector = _opened(file, _reading(layout, names, person, tiles, overlap, whole, input_size), score)
    _print_reading(detector)
    if source.suffix.lower() in (".mp4", ".mov", ".mkv", ".avi", ".ts", ".m4v", ".webm"):
        _try_video(detector, source, out or Path(f"{file.stem}-{source.stem}.mp4"), pictures)
    else:
        _try_picture(detector, source, out or Path(f"{file.stem}-{source.stem}.png"))


@app.command()
def add(
    file: Model,
    out: Annotated[Path, typer.Option(help="The pool file to write; must not exist.")],
    machine: Annotated[str, typer.Option(help="Name of this machine's type, as inventories have it.")],
    labels: Annotated[Path | None, typer.Option(help="COCO JSON of labelled stills.")] = None,
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
    import numpy as np

    from pipeline.config.evaluation import Setup
    from pipeline.detection.crash_test import require_survivable
    from pipeline.evaluation.pool.detector_row import NewDetector, assumed_row, measured_row, timed, write_row

    if (labels is None) == (assume_like is None):
        found = "neither" if labels is None else "both"
        raise InputError("--labels, --assume-like", found, "one of both")
    if out.exists():
        raise InputError(out, "a file that is there already", "a new name")
    _require_file(file)
    require_survivable(file)
    reading = _reading(layout, names, person, tiles, overlap, whole, input_size)
    setup = Setup(machine=machine, provider=provider, threads=threads)
    new = NewDetector(name or file.stem, file, reading, setup)
    like = None if assume_like is None else _pool_detector(pool, assume_like)
    result = None if labels is None else _measured(file, reading, labels, pictures, setup)
    width, height = _pair(timed_size, "--timed-size") or (1920, 1080)
    noise = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    timing = timed(new, [noise], lambda part: say(f"timing: {part}"))
    if result is not None:
        row = measured_row(new, result, timing, out)
        accuracy = f"AP .5 on {result.pictures} labelled stills with {result.people} people, as they are"
    else:
        assert like is not None
        row = assumed_row(new, like, timing, out)
        accuracy = f"assumed as that of {like.id} in {pool}"
    where = f"pictures of {width} x {height}"
    write_row(out, row, {"accuracy": accuracy, "times": where, "command": "searchlight detector add"})
    say(f"times: mean {1e3 * timing.mean_s:.1f} ms, maximum {1e3 * timing.maximum_s:.1f} ms on {where}")
    say(f"assumed: {row['assumed']}")
    say(f"pool: {out}")


def _measured(file: Path, reading: Reading, labels: Path, pictures: Path | None, setup: Any) -> Any:
    from pipeline.config.evaluation import FaultPolicy
    from pipeline.detection import load_as
    from pipeline.evaluation.datasets.fault_log import FaultLog
    from pipeline.evaluation.stills import SCORE_CUTOFF, labelled_stills, measure_stills

    faults = FaultLog(FaultPolicy(missing_image="skip", outside_box="skip", duplicate_id="skip"))
    dataset = labelled_stills(labels, pictures, faults)
    detector = load_as(
        file, reading, score_threshold=SCORE_CUTOFF, threads=setup.threads, provider=setup.provider
    )
    _print_reading(detector)
    with progress_bars("pictures") as progress:
        result = measure_stills(detector, dataset, faults, lambda done, of: progress("looking", done, of))
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


def _try_picture(detector: Detector, source: Path, out: Path) -> None:
    from matplotlib.image import imsave

    from pipeline.detection.drawing import with_boxes
    from pipeline.detection.picture_file import read_picture

    image = read_picture(source)
    boxes, scores, classes = detector.detect(image)
    for box, score in zip(boxes, scores, strict=True):
        typer.echo(f"{score:.2f}  " + "  ".join(f"{value:.0f}" for value in box))
    imsave(str(out), with_boxes(image, boxes, classes))
    say(f"{len(boxes)} boxes; see {out}")


def _try_video(detector: Detector, source: Path, out: Path, most: int) -> None:
    from pipeline.config.scenario import Recording
    from pipeline.detection.drawing import with_boxes
    from pipeline.ingest.video.file import decoded_frames
    from pipeline.simulation.video_writer import write_video

    counts: list[int] = []

    def drawn() -> Iterator[NDArray[np.uint8]]:
        for frame in islice(decoded_frames(source), most):
            image: Any = frame.to_ndarray(format="rgb24")
            boxes, _, classes = detector.detect(image)
            counts.append(len(boxes))
            height, width = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
            yield with_boxes(image, boxes, classes)[:height, :width]

    recording = Recording.model_validate(
        {"frame_rate": {"hertz": 25}, "bitrate": {"mbps": 8}, "preset": "veryfast"}
    )
    write_video(out, drawn(), recording)
    if not counts:
        raise InputError(source, "no pictures", "a video")
    with_any = sum(count > 0 for count in counts)
    say(f"{sum(counts)} boxes in {len(counts)} pictures, of which {with_any} have any; see {out}")


def _reading(
    layout: str | None,
    names: str | None,
    person: str | None,
    tiles: str | None,
    overlap: float,
    whole: bool,
    input_size: str | None,
) -> Reading:
    from pipeline.config.layout import Layout
    from pipeline.config.pool import Tiles as TilesRecord
    from pipeline.detection import Reading
    from pipeline.sensor.setup import Tiling

    described: str | Layout | None = layout
    if layout is not None and layout.endswith((".yaml", ".yml")):
        described = _layout_file(Path(layout))
    listed: Any = names if names in (None, "coco", "coco91") else _words(names or "")
    size = _pair(tiles, "--tiles")
    tiling = None
    if size is not None:
        TilesRecord(size=size, overlap=overlap, whole=whole)
        tiling = Tiling(*size, overlap, whole)
    classes = {} if person is None else {"person": _words(person)}
    return Reading(described, listed, classes, _pair(input_size, "--input-size"), tiling)


def _layout_file(path: Path) -> Any:
    from pydantic import Field

    from pipeline.config.base import Strict, load
    from pipeline.config.layout import Layout

    class LayoutFile(Strict):
        layout: Layout
        names: tuple[str, ...] = Field(default=())

    return load(path, LayoutFile).layout


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _pair(text: str | None, option: str) -> tuple[int, int] | None:
    if text is None:
        return None
    wide, _, high = text.lower().partition("x")
    if not (wide.isdecimal() and (high or wide).isdecimal() and 32 <= int(wide) <= 16384):
        raise InputError(option, repr(text), "WIDTHxHEIGHT in pixels, 32 to 16384")
    if not 32 <= int(high or wide) <= 16384:
        raise InputError(option, repr(text), "WIDTHxHEIGHT in pixels, 32 to 16384")
    return int(wide), int(high or wide)


def _opened(file: Path, reading: Reading, score: float) -> Detector:
    from pipeline.detection import load_as

    return load_as(file, reading, score_threshold=score, threads=1, provider="cpu")


def _print_reading(detector: Detector) -> None:
    found = detector.recognised
    if found is not None:
        say(f"read as {found.name}")
        for sentence in found.assumed:
            say(f"assumed: {sentence}")


def _require_file(file: Path) -> None:
    if not file.is_file():
        raise InputError(file, "no file", "a detector as an ONNX file")


def register(application: Any) -> None:
    """Add the sub-commands to the application."""
    application.add_typer(app, name="detector")

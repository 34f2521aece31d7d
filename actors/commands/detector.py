"""``searchlight detector``: what a network is read as, what it finds, and a row of a pool for it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from actors.commands.detector_add import add
from actors.commands.detector_options import (
    InputSize,
    LayoutOption,
    Model,
    Names,
    Overlap,
    Person,
    Score,
    Tiles,
    Whole,
    opened,
    print_reading,
    reading_of,
    require_file,
)
from actors.commands.tiling_cost import say_tiling_of
from actors.terminal import say
from pipeline.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from pipeline.detection import Detector

app = typer.Typer(no_args_is_help=True, help="Look at a detector, try it, add it to a pool.")
app.command()(add)


@app.command()
def inspect(file: Model, layout: LayoutOption = None, names: Names = None, person: Person = None) -> None:
    """What a detector is read as, and why; what was assumed; its layout as a pool would describe it."""
    from pipeline.detection.crash_test import require_survivable
    from pipeline.detection.layout_section import layout_yaml

    require_file(file)
    require_survivable(file)
    detector = opened(file, reading_of(layout, names, person, None, 0.2, False, None), 0.3)
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

    require_file(file)
    require_survivable(file)
    detector = opened(file, reading_of(layout, names, person, tiles, overlap, whole, input_size), score)
    print_reading(detector)
    if source.suffix.lower() in (".mp4", ".mov", ".mkv", ".avi", ".ts", ".m4v", ".webm"):
        _try_video(detector, source, out or Path(f"{file.stem}-{source.stem}.mp4"), pictures)
    else:
        _try_picture(detector, source, out or Path(f"{file.stem}-{source.stem}.png"))


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
    say_tiling_of(detector, image)


def _try_video(detector: Detector, source: Path, out: Path, most: int) -> None:
    from pipeline.config.scenario import Recording
    from pipeline.detection.drawing import with_boxes
    from pipeline.ingest.video.file import decoded_frames
    from pipeline.simulation.video_writer import write_video

    counts: list[int] = []
    image: Any = None

    def drawn() -> Iterator[NDArray[np.uint8]]:
        nonlocal image
        for frame in islice(decoded_frames(source), most):
            image = frame.to_ndarray(format="rgb24")
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
    say_tiling_of(detector, image)


def register(application: Any) -> None:
    """Add the sub-commands to the application."""
    application.add_typer(app, name="detector")

"""How the ``detector`` commands are told to read a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from actors.terminal import say
from pipeline.errors import InputError

if TYPE_CHECKING:
    from pipeline.config.layout import Layout
    from pipeline.detection import Detector, Reading

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


def reading_of(
    layout: str | None,
    names: str | None,
    person: str | None,
    tiles: str | None,
    overlap: float,
    whole: bool,
    input_size: str | None,
) -> Reading:
    """What the options say. Raises InputError for what makes no sense."""
    from pipeline.config.pool import Tiles as TilesRecord
    from pipeline.detection import Reading
    from pipeline.sensor.setup import Tiling

    described: str | Layout | None = layout
    listed: Any = names if names in (None, "coco", "coco91") else _words(names or "")
    if layout is not None and layout.endswith((".yaml", ".yml")):
        described, named = _layout_file(Path(layout))
        listed = listed or named
    size = pair(tiles, "--tiles")
    tiling = None
    if size is not None:
        TilesRecord(size=size, overlap=overlap, whole=whole)
        tiling = Tiling(*size, overlap, whole)
    classes = {} if person is None else {"person": _words(person)}
    return Reading(described, listed, classes, pair(input_size, "--input-size"), tiling)


def _layout_file(path: Path) -> tuple[Layout, tuple[str, ...] | None]:
    """The layout, and the names if they stand beside it."""
    from pydantic import Field, create_model

    from pipeline.config.base import Strict, load
    from pipeline.config.layout import Layout

    # made here: its types must be known at run time, and the program's start imports none of them
    named = Field(default=())
    schema = create_model("LayoutFile", __base__=Strict, layout=(Layout, ...), names=(tuple[str, ...], named))
    file: Any = load(path, schema)
    return file.layout, file.names or None


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def pair(text: str | None, option: str) -> tuple[int, int] | None:
    """Width and height of such as 640x480. Raises InputError."""
    if text is None:
        return None
    wide, _, high = text.lower().partition("x")
    if not (wide.isdecimal() and (high or wide).isdecimal() and 32 <= int(wide) <= 16384):
        raise InputError(option, repr(text), "WIDTHxHEIGHT in pixels, 32 to 16384")
    if not 32 <= int(high or wide) <= 16384:
        raise InputError(option, repr(text), "WIDTHxHEIGHT in pixels, 32 to 16384")
    return int(wide), int(high or wide)


def opened(file: Path, reading: Reading, score: float) -> Detector:
    """On one thread of the processor. Raises InputError for a model that cannot be used."""
    from pipeline.detection import load_as

    return load_as(file, reading, score_threshold=score, threads=1, provider="cpu")


def print_reading(detector: Detector) -> None:
    """What it was recognised as, and what was assumed."""
    found = detector.recognised
    if found is not None:
        say(f"read as {found.name}")
        for sentence in found.assumed:
            say(f"assumed: {sentence}")


def require_file(file: Path) -> None:
    """Raises InputError if there is none."""
    if not file.is_file():
        raise InputError(file, "no file", "a detector as an ONNX file")

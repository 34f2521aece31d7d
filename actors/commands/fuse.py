"""``searchlight fuse``: the map of detections that a team has already."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from actors.terminal import say
from pipeline.errors import InputError


class LookedAt(StrEnum):
    """all: a picture without a result was looked at and shows nobody. listed: nobody looked at it."""

    ALL = "all"
    LISTED = "listed"


def fuse(
    mission: Annotated[Path, typer.Argument(help="The mission file; its inventory and pool are not read.")],
    detections: Annotated[
        Path,
        typer.Option(help="COCO results (JSON), or a CSV: stream, frame or time, x, y, w, h, score, class."),
    ],
    out: Annotated[Path, typer.Option(help="Run directory; new, empty, or of an earlier run.")],
    images: Annotated[
        Path | None, typer.Option(help="COCO file that names the files of the results' image ids.")
    ] = None,
    looked_at: Annotated[
        LookedAt | None, typer.Option(help="Pictures without a result: looked at (all), or not (listed).")
    ] = None,
    name: Annotated[str, typer.Option(help="What the detector is called in the report.")] = "own",
    accuracy: Annotated[
        float | None,
        typer.Option(
            min=0.0, max=1.0, help="Relative to the best that the sensor model knows; absent: 1, assumed."
        ),
    ] = None,
    calibration: Annotated[
        tuple[float, float] | None, typer.Option(help="Scale and offset over the log-odds of the scores.")
    ] = None,
    min_score: Annotated[float, typer.Option(min=0.0, max=1.0, help="Boxes below are not used.")] = 0.3,
    classes: Annotated[
        list[str] | None,
        typer.Option("--class", help="LABEL=NAME: a label of the file is that class of the mission."),
    ] = None,
    first_frame: Annotated[
        int | None, typer.Option(help="Number of a video's first picture, 0 or 1.")
    ] = None,
    frame_rate: Annotated[
        float | None,
        typer.Option(min=1e-3, help="Hz: the numbers count pictures taken from the video at this rate."),
    ] = None,
    picture_size: Annotated[
        str | None,
        typer.Option(help="WIDTHxHEIGHT of the pictures that the boxes are of, if not the video's."),
    ] = None,
    onto: Annotated[Path | None, typer.Option(help="Directory of an earlier run, whose map goes on.")] = None,
) -> None:
    """Geolocate and fuse detections that were made elsewhere, without allocation or models."""
    from pipeline.config.pool import Calibration
    from pipeline.mission.fuse import fuse as fuse_detections
    from pipeline.mission.onto import read_earlier_run
    from pipeline.mission.own_detections import OwnDetector
    from pipeline.mission.picture_finder import Numbering
    from pipeline.mission.run_directory import write_run_directory
    from pipeline.storage.whole_or_nothing import check_run_directory

    check_run_directory(out)
    if calibration is not None and not calibration[0] > 0.0:
        raise InputError("--calibration", f"a scale of {calibration[0]:g}", "a scale above 0, and an offset")
    detector = OwnDetector(
        name,
        accuracy,
        None if calibration is None else Calibration(scale=calibration[0], offset=calibration[1]),
        min_score,
        dict(_pair(text) for text in classes or ()),
        Numbering(first_frame, frame_rate),
        None if picture_size is None else _size(picture_size),
    )
    prepared, finished = fuse_detections(
        mission, detections, images, None if looked_at is None else looked_at.value, detector,
        None if onto is None else read_earlier_run(onto),
    )  # fmt: skip
    summary = write_run_directory(prepared, finished, out)
    for sentence in summary.own_detections:
        say(sentence)
    say(f"{summary.verdict.sentence} See {out / 'report.html'}")


def _pair(text: str) -> tuple[str, str]:
    label, sign, name = text.partition("=")
    if not sign or not label or not name:
        raise InputError("--class", repr(text), "LABEL=NAME")
    return label, name


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise InputError("--picture-size", repr(text), "WIDTHxHEIGHT, such as 640x360")
    return int(width), int(height)

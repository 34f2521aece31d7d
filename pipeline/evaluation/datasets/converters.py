"""MOT and VisDrone annotations as COCO JSON with the one category person."""

from __future__ import annotations

import configparser
import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import av

from pipeline.errors import InputError
from pipeline.evaluation.datasets.fault_log import FaultLog

Format = Literal["mot", "visdrone"]
Row = tuple[int, tuple[float, float, float, float], bool, float]
_IMAGES = {".jpg", ".jpeg", ".png", ".bmp"}
#: MOT classes: 1 pedestrian; neither right nor wrong: 2 on a vehicle, 7 static, 8 distractor, 12 reflection
_MOT_PERSON, _MOT_NEUTRAL = 1, {2, 7, 8, 12}
#: VisDrone categories: 0 ignored region, 1 pedestrian, 2 people
_VISDRONE_PERSON, _VISDRONE_NEUTRAL = {1, 2}, 0


def converted(kind: Format, folder: Path, faults: FaultLog) -> dict[str, Any]:
    """A COCO document of a folder in the data set's own layout; file names are relative to the folder.

    mot: SEQUENCE/seqinfo.ini, img1/, gt/gt.txt, or one such sequence. visdrone: images/ and annotations/ of
    single pictures, or sequences/NAME/ and annotations/NAME.txt. Raises InputError with file and line.
    """
    if not folder.is_dir():
        raise InputError(folder, "no folder", f"a folder with {kind} annotations")
    document: dict[str, Any] = {
        "images": [], "annotations": [], "videos": [], "categories": [{"id": 1, "name": "person"}],
    }  # fmt: skip
    for name, images, rows in _mot(folder, faults) if kind == "mot" else _visdrone(folder):
        _add(document, folder, name, images, rows)
    if not document["images"]:
        raise InputError(
            folder, f"no {kind} sequence", "MOT or VisDrone folders with pictures and annotations"
        )
    return document


def _add(
    document: dict[str, Any], folder: Path, name: str | None, images: dict[int, Path], rows: list[Row]
) -> None:
    """One sequence, or single pictures if it has no name; images by frame number."""
    first = len(document["images"]) + 1
    ids = {frame: first + k for k, frame in enumerate(sorted(images))}
    sizes: dict[str, int] = {}
    if name is not None:
        document["videos"].append({"id": len(document["videos"]) + 1, "name": name})
    for frame, key in ids.items():
        if name is None or not sizes:
            sizes = dict(zip(("width", "height"), _size(images[frame]), strict=True))
        image = {"id": key, "file_name": images[frame].relative_to(folder).as_posix(), **sizes}
        if name is not None:
            image |= {"video_id": len(document["videos"]), "frame_id": frame}
        document["images"].append(image)
    for frame, box, ignored, visible in rows:
        # a frame without a picture keeps an id that no picture has: whoever reads the file will say so
        document["annotations"].append(
            {
                "id": len(document["annotations"]) + 1,
                "image_id": ids.get(frame, -frame),
                "category_id": 1,
                "bbox": list(box),
                "area": box[2] * box[3],
                "iscrowd": int(ignored),
                "visible_share": visible,
            }
        )


def _mot(folder: Path, faults: FaultLog) -> Iterator[tuple[str | None, dict[int, Path], list[Row]]]:
    own = (
        [folder]
        if (folder / "seqinfo.ini").is_file()
        else sorted(p.parent for p in folder.glob("*/seqinfo.ini"))
    )
    for sequence in own:
        info = _seqinfo(sequence / "seqinfo.ini")
        images = {int(p.stem): p for p in _images(sequence / info["imdir"]) if p.stem.isdigit()}
        promised = int(info["seqlength"])
        if len(images) != promised:
            where = f"{sequence / 'seqinfo.ini'} seqLength"
            faults.report("frame_count", where, str(promised), f"{len(images)}, as there are pictures")
        yield sequence.name, images, [row for row in map(_mot_row, *_lines(sequence / "gt/gt.txt", 9)) if row]


def _seqinfo(path: Path) -> dict[str, str]:
    parser = configparser.ConfigParser()
    try:
        parser.read_string(path.read_text(encoding="utf-8"))
        info = {"imdir": "img1"} | dict(parser["Sequence"])
        int(info["seqlength"])
    except (OSError, KeyError, ValueError, configparser.Error) as error:
        raise InputError(
            path, f"no usable sequence ({str(error).splitlines()[0]})", "[Sequence] with seqLength"
        ) from None
    return info


def _mot_row(where: str, values: list[float]) -> Row | None:
    """frame, id, left, top, width, height, considered, class, visibility; the first pixel is 1."""
    frame, _, left, top, width, height, considered, kind, visible = values[:9]
    if int(kind) != _MOT_PERSON and int(kind) not in _MOT_NEUTRAL:
        return None
    if width <= 0 or height <= 0:
        raise InputError(where, f"a box of {width:g} x {height:g}", "positive width and height")
    ignored = int(kind) != _MOT_PERSON or considered == 0
    return int(frame), (left - 1.0, top - 1.0, width, height), ignored, visible


def _visdrone(folder: Path) -> Iterator[tuple[str | None, dict[int, Path], list[Row]]]:
    for sequence in sorted(p for p in (folder / "sequences").glob("*") if p.is_dir()):
        images = {int(p.stem): p for p in _images(sequence) if p.stem.isdigit()}
        lines = _lines(folder / "annotations" / f"{sequence.name}.txt", 10)
        rows = [_visdrone_row(w, int(v[0]), v[2:]) for w, v in zip(*lines, strict=True)]
        yield sequence.name, images, [row for row in rows if row]
    single = dict(enumerate(_images(folder / "images"), 1))
    rows = []
    for number, image in single.items():
        where, values = _lines(folder / "annotations" / f"{image.stem}.txt", 8)
        rows += [_visdrone_row(w, number, v) for w, v in zip(where, values, strict=True)]
    if single:
        yield None, single, [row for row in rows if row]


def _visdrone_row(where: str, frame: int, values: list[float]) -> Row | None:
    """left, top, width, height, considered, category, ..; what is not considered is ignored."""
    left, top, width, height, considered, category = values[:6]
    neutral = int(category) == _VISDRONE_NEUTRAL
    if not neutral and int(category) not in _VISDRONE_PERSON:
        return None
    if width <= 0 or height <= 0:
        raise InputError(where, f"a box of {width:g} x {height:g}", "positive width and height")
    return frame, (left, top, width, height), neutral or considered == 0, 1.0


def _lines(path: Path, least: int) -> tuple[list[str], list[list[float]]]:
    """Where each line stands, and its numbers."""
    where, rows = [], []
    try:
        lines = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
    except FileNotFoundError:
        raise InputError(path, "no file", "the annotations of its pictures") from None
    except (OSError, ValueError) as error:
        raise InputError(path, f"an unreadable file ({error})", "lines of numbers") from None
    for number, line in enumerate(lines, 1):
        # VisDrone ends some lines with a comma
        cells = line[:-1] if line and not line[-1].strip() else line
        if not cells:
            continue
        try:
            rows.append([float(cell) for cell in cells])
        except ValueError:
            raise InputError(f"{path}:{number}", ",".join(line)[:60], "numbers between commas") from None
        if len(cells) < least:
            raise InputError(f"{path}:{number}", f"{len(cells)} numbers", f"at least {least}")
        where.append(f"{path}:{number}")
    return where, rows


def _images(folder: Path) -> list[Path]:
    return sorted(p for p in folder.glob("*") if p.suffix.lower() in _IMAGES) if folder.is_dir() else []


def _size(image: Path) -> tuple[int, int]:
    """Width and height in pixels."""
    try:
        with av.open(str(image)) as container:
            codec = container.streams.video[0].codec_context
            return codec.width, codec.height
    except (av.FFmpegError, OSError, IndexError):
        raise InputError(image, "a file that is not an image", "a JPEG, PNG or BMP image") from None

"""Where the pictures of a COCO file lie: image files, or frames of videos."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import InputError
from pipeline.evaluation.datasets.coco_format import CocoDocument, CocoId, CocoImage
from pipeline.evaluation.datasets.fault_log import FaultLog

#: a longer number is no frame
_MOST_DIGITS = 9


@dataclass(frozen=True, slots=True)
class CocoPicture:
    """A listed picture: which sequence, which frame of it, which file; width and height in pixels."""

    id: CocoId
    image: CocoImage
    width: int
    height: int
    sequence: str
    frame: int
    file: Path
    in_video: bool


def pictures_of(
    images: list[CocoImage],
    coco: CocoDocument,
    where: Path,
    root: Path,
    alone: bool,
    faults: FaultLog,
) -> list[CocoPicture]:
    """The pictures whose files are there, by sequence and frame.

    images: in the order that files without a frame number have in their sequence. alone: every image file is
    a sequence of its own, else every folder is one. Raises InputError for pictures without name or size.
    """
    videos = {v.id: v.name for v in coco.videos}
    found, missing = [], set()
    for rank, image in enumerate(images):
        picture = _picture(image, rank, videos, where, root, alone)
        if picture.file in missing or not picture.file.is_file():
            missing.add(picture.file)
            at = f"{where} images.id={image.id}.file_name"
            faults.report("missing_image", at, f"{image.file_name}, which is not there", f"a file in {root}")
        else:
            found.append(picture)
    return sorted(found, key=lambda p: (p.sequence, p.frame))


def _picture(
    image: CocoImage, rank: int, videos: dict[CocoId, str], where: Path, root: Path, alone: bool
) -> CocoPicture:
    at = f"{where} images.id={image.id}"
    if image.file_name is None:
        raise InputError(f"{at}.file_name", "nothing", "the picture's file, or VIDEO#FRAME")
    if image.width is None or image.height is None:
        lacking = "width" if image.width is None else "height"
        raise InputError(f"{at}.{lacking}", "nothing", "the picture's size in pixels")
    size = image.width, image.height
    name, mark, frame = image.file_name.rpartition("#")
    if mark and frame.isdecimal() and len(frame) <= _MOST_DIGITS:
        return CocoPicture(image.id, image, *size, Path(name).stem, int(frame), root / name, True)
    file = root / image.file_name
    if image.video_id is not None:
        if image.video_id not in videos or image.frame_id is None:
            raise InputError(f"{at}.video_id", repr(image.video_id), "an id in videos, and a frame_id")
        return CocoPicture(image.id, image, *size, videos[image.video_id], image.frame_id, file, False)
    sequence = image.file_name if alone else Path(image.file_name).parent.name or "images"
    return CocoPicture(image.id, image, *size, sequence, rank, file, False)

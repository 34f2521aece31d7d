"""COCO's JSON format, as far as we read it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.errors import InputError

_Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Lenient(BaseModel):
    """COCO files carry much that we do not read."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class _Context(_Lenient):
    """From where a picture was taken: metres above ground, pitch of the camera (negative is down)."""

    height_m: _Finite
    pitch_deg: _Finite
    focal_px: Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class CocoImage(_Lenient):
    """file_name: an image file, or VIDEO#FRAME. video_id, frame_id: of an image file in a sequence."""

    id: int
    file_name: str = Field(min_length=1)
    width: int = Field(gt=0)
    height: int = Field(gt=0)
    video_id: int | None = None
    frame_id: int | None = None
    context: _Context | None = None


class CocoAnnotation(_Lenient):
    """visible_share: what is visible of the object, 0..1."""

    id: int
    image_id: int
    category_id: int
    bbox: tuple[float, float, float, float]
    area: _Finite | None = None
    iscrowd: int = 0
    ignore: int = 0
    visible_share: _Finite = 1.0


class _Category(_Lenient):
    id: int
    name: str


class _Video(_Lenient):
    id: int
    name: str


class CocoDocument(_Lenient):
    """The whole file; videos: the sequences of image files that have ids."""

    images: tuple[CocoImage, ...]
    annotations: tuple[CocoAnnotation, ...]
    categories: tuple[_Category, ...]
    videos: tuple[_Video, ...] = ()


def parsed(path: Path) -> Any:
    """The content of a JSON file. Raises InputError."""
    try:
        return json.loads(path.read_bytes())
    except FileNotFoundError:
        raise InputError(path, "no file", "a COCO JSON file") from None
    except (OSError, ValueError, RecursionError) as error:
        reason = str(error).splitlines()[0][:120]
        raise InputError(path, f"a file that is not JSON ({reason})", "a COCO JSON file") from None


def validated(document: Any, where: Path) -> CocoDocument:
    """The document, if it has the format. Raises InputError naming the field; where: for the message."""
    try:
        return CocoDocument.model_validate(document)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        field = ".".join(str(key) for key in fault["loc"])
        found = "nothing" if fault["type"] == "missing" else repr(fault["input"])[:60]
        raise InputError(f"{where} {field}".rstrip(), found, fault["msg"]) from None

"""COCO's JSON format, as far as we read it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, Strict, TypeAdapter, ValidationError

from pipeline.errors import InputError

_Number = Annotated[float, Strict()]
_Finite = Annotated[float, Strict(), Field(allow_inf_nan=False)]
#: a flag is 0 or 1, true or false, or not stated
_Flag = Annotated[int, BeforeValidator(lambda value: 0 if value is None else value)]
_Box = tuple[_Number, _Number, _Number, _Number]


def _identifier(value: Any) -> int | str:
    """1 and "1" are two ids; 1.0 is 1, as JSON has one kind of number."""
    if isinstance(value, float) and value.is_integer():
        return int(value)
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise ValueError("a whole number or a text is needed")
    return value


#: of a picture, an annotation, a category, a video
CocoId = Annotated[int | str, BeforeValidator(_identifier)]


class _Lenient(BaseModel):
    """COCO files carry much that we do not read."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class _Context(_Lenient):
    """From where a picture was taken: metres above ground, pitch of the camera (negative is down)."""

    height_m: _Finite
    pitch_deg: _Finite
    focal_px: Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class CocoImage(_Lenient):
    """file_name: an image file, or VIDEO#FRAME. video_id, frame_id: of an image file in a sequence.

    width, height, file_name: not needed where nobody looks at the picture.
    """

    id: CocoId
    file_name: str | None = Field(default=None, min_length=1)
    width: int | None = Field(default=None, gt=0)
    height: int | None = Field(default=None, gt=0)
    video_id: CocoId | None = None
    frame_id: int | None = Field(default=None, ge=0)
    context: _Context | None = None


class CocoAnnotation(_Lenient):
    """area: square pixels, of the box where it is None. visible_share: what is visible of the object, 0..1."""

    id: CocoId | None = None
    image_id: CocoId
    category_id: CocoId
    bbox: _Box
    area: Annotated[_Finite, Field(ge=0.0)] | None = None
    iscrowd: _Flag = 0
    ignore: _Flag = 0
    visible_share: _Finite = 1.0


class _Category(_Lenient):
    id: CocoId
    name: str


class _Video(_Lenient):
    id: CocoId
    name: str


class CocoDocument(_Lenient):
    """The whole file; videos: the sequences of image files that have ids."""

    images: tuple[CocoImage, ...]
    annotations: tuple[CocoAnnotation, ...]
    categories: tuple[_Category, ...]
    videos: tuple[_Video, ...] = ()


class CocoResult(_Lenient):
    """One found box: x, y, width, height in pixels."""

    image_id: CocoId
    category_id: CocoId
    bbox: tuple[_Finite, _Finite, _Finite, _Finite]
    score: _Finite


_RESULTS = TypeAdapter(tuple[CocoResult, ...])
_EXPECTED_RESULTS = (
    "COCO's list of results: [{image_id, category_id, bbox: [x, y, width, height], score}, ..]"
)


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
    if not isinstance(document, dict):
        raise InputError(where, _kind(document), "COCO's truth: {images, annotations, categories}")
    try:
        return CocoDocument.model_validate(document)
    except (ValidationError, OverflowError) as error:
        raise _fault(error, where) from None


def validated_results(document: Any, where: Path) -> tuple[CocoResult, ...]:
    """COCO's list of results. Raises InputError naming the field; where: for the message."""
    if not isinstance(document, list):
        raise InputError(where, _kind(document), _EXPECTED_RESULTS)
    try:
        return _RESULTS.validate_python(document)
    except (ValidationError, OverflowError) as error:
        raise _fault(error, where) from None


def _kind(document: Any) -> str:
    names = {dict: "a dictionary", list: "a list", str: "a text", type(None): "nothing"}
    return names.get(type(document), "a number")


def _fault(error: ValidationError | OverflowError, where: Path) -> InputError:
    """The first fault in one line."""
    if isinstance(error, OverflowError):
        return InputError(where, "a number that is too large", "numbers")
    fault = error.errors(include_url=False)[0]
    field = ".".join(str(key) for key in fault["loc"])
    if fault["type"] == "missing":
        return InputError(f"{where} {field}", "nothing", "this field, which COCO's format needs")
    return InputError(f"{where} {field}".rstrip(), repr(fault["input"])[:60], fault["msg"])

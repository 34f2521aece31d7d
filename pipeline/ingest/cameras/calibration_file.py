"""Calibration files: Searchlight's own, OpenCV's FileStorage (YAML, XML, JSON) and ROS's camera_info."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml

from pipeline.config.camera import load_camera
from pipeline.errors import InputError
from pipeline.geo.camera import Camera
from pipeline.messages import FloatArray

_MOST_BYTES = 1_000_000
_EXPECTED = (
    "a calibration: Searchlight's, OpenCV's (camera_matrix, distortion_coefficients) or a ROS camera_info"
)
#: names of the same thing in OpenCV's samples and tools and in ROS, without case and underscores
_MATRIX = ("cameramatrix", "k", "intrinsicmatrix", "mtx")
_COEFFICIENTS = ("distortioncoefficients", "distcoeffs", "distcoefs", "d", "dist", "distortion")
_WIDTH, _HEIGHT = ("imagewidth", "width"), ("imageheight", "height")
_SIZE = ("imagesize", "resolution", "size")
_PINHOLE_MODELS = ("plumb_bob", "rational_polynomial", "radtan", "brown_conrady", "pinhole", "none", "")
_WAY_OUT = "a calibration with the pinhole model (cv2.calibrateCamera) of undistorted pictures"


@dataclass(frozen=True)
class CalibrationFile:
    """camera: width and height are 0 where the file does not say them. assumed: a sentence each."""

    camera: Camera
    assumed: tuple[str, ...] = ()


def read_calibration(path: Path) -> CalibrationFile:
    """Read a calibration file of any known kind. Raises InputError for anything else."""
    text = _text(path)
    head = text.lstrip("\ufeff \t\r\n")
    if head.startswith("<"):
        return _opencv(path, _xml(path, text))
    if not head.startswith("%YAML:") and not _looks_foreign(text):
        return CalibrationFile(load_camera(path))
    return _opencv(path, _yaml(path, text))


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(path, f"{path.stat().st_size} bytes", _EXPECTED)
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(path, "no file", _EXPECTED) from None
    except OSError as error:
        raise InputError(path, f"a file that cannot be read ({error.strerror})", _EXPECTED) from None
    except ValueError:
        raise InputError(path, "a file that is not text", _EXPECTED) from None


def _looks_foreign(text: str) -> bool:
    keys = {
        _plain(key) for key in re.findall(r"(?:^|[{,])[ \t]*\"?([A-Za-z_]+)\"?[ \t]*:", text, re.MULTILINE)
    }
    return bool(keys & {*_MATRIX, *_COEFFICIENTS[:-1]})


class _OpenCvLoader(yaml.SafeLoader):
    """SafeLoader that knows OpenCV's matrices."""


def _mapping(loader: yaml.SafeLoader, _suffix: str, node: yaml.Node) -> Any:
    if not isinstance(node, yaml.MappingNode):
        raise yaml.constructor.ConstructorError(None, None, "not a matrix", node.start_mark)
    return loader.construct_mapping(node, deep=True)


_OpenCvLoader.add_multi_constructor("tag:yaml.org,2002:opencv-", _mapping)


def _yaml(path: Path, text: str) -> Mapping[str, Any]:
    # OpenCV writes "%YAML:1.0", which is not YAML
    body = re.sub(r"^\s*%YAML:[^\n]*\n", "", text)
    try:
        document = yaml.load(body, Loader=_OpenCvLoader)  # a SafeLoader
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError, LookupError, TypeError) as error:
        mark = getattr(error, "problem_mark", None)
        line = "" if mark is None else f":{mark.line + 1 + (body != text)}"
        raise InputError(f"{path}{line}", "text that is not YAML", _EXPECTED) from None
    if not isinstance(document, dict):
        raise InputError(path, "no keys and values", _EXPECTED)
    return document


def _xml(path: Path, text: str) -> Mapping[str, Any]:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(path, "XML with a document type", _EXPECTED)
    try:
        root = ElementTree.fromstring(re.sub(r"^\s*<\?xml[^>]*\?>", "", text))
    except (ElementTree.ParseError, ValueError, RecursionError):
        raise InputError(path, "text that is not XML", _EXPECTED) from None
    return {node.tag: _xml_value(node) for node in root}


def _xml_value(node: ElementTree.Element) -> Any:
    if len(node):
        return {child.tag: _xml_value(child) for child in node}
    words = (node.text or "").split()
    return words[0] if len(words) == 1 else words


def _plain(key: object) -> str:
    return str(key).lower().replace("_", "").replace("-", "")


def _opencv(path: Path, document: Mapping[str, Any]) -> CalibrationFile:
    fields = {_plain(key): value for key, value in document.items()}
    _refuse_other_models(path, fields)
    matrix = _numbers(path, "camera_matrix", _first(fields, _MATRIX))
    if len(matrix) != 9:
        raise InputError(f"{path} camera_matrix", f"{len(matrix)} numbers", "3 x 3 numbers")
    (fx, skew, cx), (below, fy, cy), last = matrix.reshape(3, 3).tolist()
    if below != 0.0 or last != [0.0, 0.0, 1.0] or fx <= 0.0 or fy <= 0.0:
        raise InputError(f"{path} camera_matrix", _short(matrix), "fx, 0, cx, 0, fy, cy, 0, 0, 1")
    if abs(skew) > 1e-3 * fx:
        raise InputError(f"{path} camera_matrix", f"a skew of {skew:g}", "pixels without skew: 0")
    coefficients, assumed = _coefficients(path, fields)
    width, height = _size(path, fields)
    # OpenCV counts pixels from the centre of the first one, Searchlight from its corner
    return CalibrationFile(Camera(width, height, fx, fy, cx + 0.5, cy + 0.5, coefficients), assumed)


def _refuse_other_models(path: Path, fields: Mapping[str, Any]) -> None:
    model = fields.get("distortionmodel", "")
    if isinstance(model, str) and model.lower() not in _PINHOLE_MODELS:
        raise InputError(f"{path} distortion_model", f"the lens model {model!r}", _WAY_OUT)
    if str(fields.get("fisheyemodel", "0")).lower() not in ("0", "0.0", "false", "none"):
        raise InputError(f"{path} fisheye_model", "a fisheye lens", _WAY_OUT)
    if "xi" in fields:
        raise InputError(f"{path} xi", "an omnidirectional lens", _WAY_OUT)


def _coefficients(path: Path, fields: Mapping[str, Any]) -> tuple[FloatArray, tuple[str, ...]]:
    found = _first(fields, _COEFFICIENTS)
    values = np.zeros(0) if found is None else _numbers(path, "distortion_coefficients", found)
    if len(values) in (12, 14) and not values[8:].any():
        values = values[:8]
    if len(values) not in (0, 4, 5, 8):
        expected = "4, 5 or 8 of OpenCV's coefficients (no thin prism, no tilted sensor)"
        raise InputError(f"{path} distortion_coefficients", f"{len(values)} coefficients", expected)
    coefficients = np.zeros(max(len(values), 5))
    coefficients[: len(values)] = values
    said = fields.get("distortionmodel") or "fisheyemodel" in fields
    if len(values) == 4 and not said:
        return coefficients, (f"{path}: the 4 coefficients are k1, k2, p1, p2, not those of a fisheye lens",)
    if found is None:
        return coefficients, (f"{path}: the lens does not distort",)
    return coefficients, ()


def _size(path: Path, fields: Mapping[str, Any]) -> tuple[int, int]:
    width, height = _first(fields, _WIDTH), _first(fields, _HEIGHT)
    if width is None and height is None and (both := _first(fields, _SIZE)) is not None:
        sizes = _numbers(path, "image_size", both)
        width, height = sizes if len(sizes) == 2 else (None, None)
    if width is None or height is None:
        return 0, 0
    (w,), (h,) = _numbers(path, "image_width", [width]), _numbers(path, "image_height", [height])
    if not (16.0 <= w <= 16384.0 and 16.0 <= h <= 16384.0 and w == int(w) and h == int(h)):
        raise InputError(f"{path} image_width, image_height", f"{w:g} x {h:g}", "16 to 16384 pixels")
    return int(w), int(h)


def _first(fields: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    return next((fields[name] for name in names if fields.get(name) is not None), None)


def _numbers(path: Path, name: str, value: Any) -> FloatArray:
    """The numbers in a matrix of OpenCV's or ROS's, or in lists of lists."""
    if value is None:
        raise InputError(f"{path} {name}", "nothing", _EXPECTED)
    if isinstance(value, Mapping):
        value = value.get("data")
    try:
        if isinstance(value, str):
            value = value.split()
        numbers = np.array(value, dtype=np.float64).ravel()
    except (ValueError, TypeError, OverflowError):
        raise InputError(f"{path} {name}", "something else than numbers", "numbers") from None
    if not numbers.size or numbers.size > 100 or not all(map(math.isfinite, numbers.tolist())):
        raise InputError(f"{path} {name}", _short(numbers), "finite numbers")
    return numbers


def _short(numbers: FloatArray) -> str:
    return ", ".join(f"{x:g}" for x in numbers[:9].tolist()) or "no number"

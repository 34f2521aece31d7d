"""A detector in another number format: a derived ONNX file, evaluated as a detector of its own."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pipeline.config.evaluation import EvaluatedDetector
from pipeline.errors import InputError
from pipeline.storage.whole_or_nothing import replacing


def in_precision(detector: EvaluatedDetector, folder: Path) -> Path:
    """The model file to evaluate: the detector's own, or folder / ID.onnx in the precision asked for.

    float16: weights and sums, inputs and outputs as before. int8: weights, and activations by their range in
    each picture (dynamic quantisation). Raises InputError if the package onnx is not installed, or if the
    model cannot be converted.
    """
    if detector.precision == "as_exported":
        return detector.model
    if not detector.model.is_file():
        raise InputError(detector.model, "no file", "a detector as an ONNX file")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{detector.id}.onnx"
    try:
        with replacing(path) as temporary, _quiet():
            {"float16": _float16, "int8": _int8}[detector.precision](detector.model, temporary)
    except ModuleNotFoundError as error:
        found = f"no module {error.name}, which {detector.precision} needs"
        raise InputError("the extra 'train'", found, "pip install 'searchlight[train]'") from None
    except InputError:
        raise
    except Exception as error:  # the converters' errors have no common root
        reason = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        found = f"a model that cannot be converted to {detector.precision} ({reason})"
        raise InputError(detector.model, found, "precision: as_exported") from None
    return path


@contextmanager
def _quiet() -> Iterator[None]:
    """The converters warn about every tensor that they leave as it is."""
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


def _float16(source: Path, target: Path) -> None:
    import onnx
    from onnxruntime.transformers.float16 import convert_float_to_float16

    model: Any = onnx.load(source)
    onnx.save(convert_float_to_float16(model, keep_io_types=True), target)


def _int8(source: Path, target: Path) -> None:
    from onnxruntime.quantization import QuantType, quantize_dynamic

    quantize_dynamic(source, target, weight_type=QuantType.QUInt8)

"""People in pictures: ONNX Runtime sessions and one adapter per output layout."""

from pipeline.detection.detector import (
    PERSONS,
    Detector,
    NotFiniteError,
    Reading,
    load_as,
    load_detector,
    open_pool_detector,
)
from pipeline.detection.recognition import LayoutQuestionError

__all__ = [
    "PERSONS",
    "Detector",
    "LayoutQuestionError",
    "NotFiniteError",
    "Reading",
    "load_as",
    "load_detector",
    "open_pool_detector",
]

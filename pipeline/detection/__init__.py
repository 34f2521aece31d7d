"""People in pictures: ONNX Runtime sessions and one adapter per output layout."""

from pipeline.detection.detector import Detector, NotFiniteError, load_detector, open_pool_detector
from pipeline.detection.recognition import LayoutQuestionError

__all__ = ["Detector", "LayoutQuestionError", "NotFiniteError", "load_detector", "open_pool_detector"]

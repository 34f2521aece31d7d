"""People in pictures: ONNX Runtime sessions and one adapter per output layout."""

from pipeline.detection.detector import Detector, NotFiniteError, load_detector, open_pool_detector

__all__ = ["Detector", "NotFiniteError", "load_detector", "open_pool_detector"]

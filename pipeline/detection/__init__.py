"""People in pictures: ONNX Runtime sessions and one adapter per output layout."""

from pipeline.detection.detector import Detector, load_detector

__all__ = ["Detector", "load_detector"]

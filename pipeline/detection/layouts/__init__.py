"""Layouts of networks: one file each, what a user's package adds, and what each says of a model."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import entry_points
from typing import cast

from pipeline.detection.facts import Facts
from pipeline.detection.layouts import (
    damoyolo,
    fastestdet,
    nanodet,
    nms_in_graph,
    picodet,
    rtdetr,
    searchlight,
    tf_ssd,
    torchvision,
    yolo_fastestv2,
    yolov5,
    yolov6,
    yolov8,
    yolov10,
    yoloworld,
    yolox,
)
from pipeline.detection.layouts.proposal import LayoutFamily, Proposal

ENTRY_POINT = "searchlight.detector_layouts"
BUILT_IN: tuple[LayoutFamily, ...] = (
    searchlight,
    yolov8,
    yolov5,
    yolov10,
    yolox,
    yolov6,
    yolo_fastestv2,
    nanodet,
    picodet,
    fastestdet,
    damoyolo,
    rtdetr,
    nms_in_graph,
    tf_ssd,
    torchvision,
    yoloworld,
)


def families() -> tuple[LayoutFamily, ...]:
    """Those of installed packages first, then the built-in ones."""
    added = tuple(cast(LayoutFamily, point.load()) for point in entry_points(group=ENTRY_POINT))
    return (*added, *BUILT_IN)


def proposals(facts: Facts) -> Sequence[Proposal]:
    """All ways to read a model. Raises InputError if a family knows it and cannot use it."""
    first = searchlight.propose(facts)
    if first:
        return first
    return [p for family in families() if family is not searchlight for p in family.propose(facts)]

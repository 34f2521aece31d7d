"""One adapter per output layout, and how a model's layout is recognised."""

from __future__ import annotations

from pipeline.detection.layouts.base import Layout
from pipeline.detection.layouts.deim import DeimLayout
from pipeline.detection.layouts.fastestdet import FastestDetLayout
from pipeline.detection.layouts.nanodet import NanoDetLayout
from pipeline.detection.layouts.searchlight import SearchlightLayout
from pipeline.detection.layouts.yolox import LightPersonLayout, YoloxLayout
from pipeline.detection.session import Signature

LAYOUTS: tuple[type[Layout], ...] = (
    SearchlightLayout,
    FastestDetLayout,
    NanoDetLayout,
    YoloxLayout,
    LightPersonLayout,
    DeimLayout,
)


def recognise(signature: Signature) -> Layout | None:
    """The layout of a model, None if it is none that we know."""
    for layout in LAYOUTS:
        found = layout.recognise(signature)
        if found is not None:
            return found
    return None

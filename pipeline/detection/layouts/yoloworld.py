"""YOLO-World (https://github.com/AILab-CVC/YOLO-World) that takes its texts as an input."""

from __future__ import annotations

from pipeline.detection.facts import Facts, is_float
from pipeline.detection.layouts.proposal import Proposal
from pipeline.errors import InputError

name = "yoloworld"
_TEXT_SIZES = (512, 768, 1024)


def propose(facts: Facts) -> list[Proposal]:
    """Nothing: what its second input holds cannot be guessed. With its texts folded in see damoyolo."""
    texts = [t for t in facts.others if len(t.shape) == 3 and t.shape[-1] in _TEXT_SIZES and is_float(t)]
    if len(facts.others) == 1 and texts:
        raise InputError(
            "its inputs",
            f"{texts[0]}, the embedded texts of a YOLO-World",
            "an export with its texts folded in (reparameterised), which has the picture as its only input",
        )
    return []

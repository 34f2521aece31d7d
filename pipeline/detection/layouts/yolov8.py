"""YOLOv8, YOLOv9, YOLO11, YOLO12 (https://github.com/ultralytics/ultralytics)."""

from __future__ import annotations

from pipeline.config.layout import Layout, Rows
from pipeline.detection.facts import Facts
from pipeline.detection.layouts.proposal import Proposal, picture_input
from pipeline.errors import InputError

name = "yolov8"
_STRIDES = ((8, 16, 32), (8, 16, 32, 64), (4, 8, 16, 32), (4, 8, 16))


def propose(facts: Facts) -> list[Proposal]:
    """Columns of decoded box and classes for each cell; also turned round, as some tools need it."""
    refuse_other_tasks(facts)
    if len(facts.outputs) != 1 or facts.others:
        return []
    (output,) = facts.outputs
    if len(output.shape) != 2:
        return []
    for strides in _STRIDES:
        for axis, order in ((1, "columns"), (0, "rows")):
            values = output.shape[1 - axis]
            if output.shape[axis] == facts.cells(*strides) and isinstance(values, int) and values >= 5:
                layout = Layout(
                    input=picture_input(facts), output=Rows(tensor=output.name, order=order), nms_iou=0.45
                )
                why = (
                    f"{output.shape[axis]} candidates are one for each cell of the strides {strides}, "
                    f"{'down' if order == 'rows' else 'across'}, with {values} values: a box and classes",
                )
                # rows have an objectness everywhere but in exports that were turned round
                return [Proposal(name, layout, why, values - 4, usual=order == "columns", grid=strides)]
    return []


def refuse_other_tasks(facts: Facts) -> None:
    """Raises InputError for a model of Ultralytics that does not detect."""
    task = facts.metadata.get("task", "detect")
    kinds = {
        "obb": "turned boxes",
        "segment": "masks",
        "pose": "key points",
        "classify": "a class for the whole picture",
    }
    if task in kinds:
        raise InputError(
            "task in its metadata", f"{task}: {kinds[task]}", "detect: export the detection model"
        )
    if len(facts.outputs) == 2:
        rows, masks = facts.outputs
        if len(rows.shape) == 2 and len(masks.shape) == 3 and masks.shape[0] == 32:
            raise InputError(
                "its outputs", f"{masks}, masks", "a model that detects: export the detection model"
            )

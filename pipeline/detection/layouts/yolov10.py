"""YOLOv10, YOLO26 and other exports with one row for each object, and YOLOv7's own."""

from __future__ import annotations

from pipeline.config.layout import Chosen, Layout, Rows
from pipeline.detection.facts import Facts
from pipeline.detection.layouts.proposal import Proposal, picture_input

name = "yolov10"
_SIX = ("x0", "y0", "x1", "y1", "score", "class")
_SEVEN = ("picture", "x0", "y0", "x1", "y1", "class", "score")


def propose(facts: Facts) -> list[Proposal]:
    """Rows (300, 6) of box, score and class; YOLOv7's (N, 7) begin with the picture; RT-DETR of Ultralytics."""
    if len(facts.outputs) != 1 or facts.others or facts.axes != "nchw":
        return []
    (output,) = facts.outputs
    if len(output.shape) == 1 and output.shape[0] in (6, 7):  # a single object: the batch axis was no batch
        values, count = output.shape[0], 1
    elif len(output.shape) == 2 and isinstance(output.shape[1], int) and isinstance(output.shape[0], int):
        count, values = output.shape[0], output.shape[1]
    else:
        return []
    if count > 1000 or count == facts.cells(8, 16, 32):
        return []
    found = []
    if values in (6, 7):
        layout = Layout(
            input=picture_input(facts),
            output=Chosen(rows=output.name, columns=_SIX if values == 6 else _SEVEN),
        )
        why = (f"rows of {values}: box, score and class of objects that the network has chosen",)
        found.append(Proposal(name if values == 6 else "yolov7_end2end", layout, why, None))
    if values >= 5 and count >= 100 and facts.metadata.get("end2end", "").lower() != "true":
        rows = Rows(tensor=output.name, unit="shares")
        layout = Layout(input=picture_input(facts, placement="stretched"), output=rows)
        why = (f"{count} queries of a box in shares of the picture and {values - 4} classes",)
        found.append(Proposal("rtdetr_ultralytics", layout, why, values - 4))
    return found

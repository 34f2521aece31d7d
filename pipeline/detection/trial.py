"""A first picture for a model: what comes out, and whether a proposed layout can be right.

The picture shows one person twice, large and small: the astronaut Eileen Collins, a portrait by NASA (public
domain).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.config.layout import Chosen, Layout, Pairs, Rows
from pipeline.detection.decoders import decode
from pipeline.detection.decoders.candidates import Candidates, Outputs, grid
from pipeline.detection.facts import Facts
from pipeline.detection.layouts.proposal import Proposal
from pipeline.detection.nms import iou
from pipeline.detection.picture_file import read_picture
from pipeline.detection.preparation import Preparation
from pipeline.detection.session import Session
from pipeline.errors import InputError
from pipeline.messages import FloatArray

_PICTURE = Path(__file__).with_name("trial_picture.jpg")
#: where the person is, xyxy in pixels, by eye
_PEOPLE = np.array([[8.0, 9.0, 280.0, 384.0], [409.0, 124.0, 551.0, 315.0]])
#: a box is the person's from this overlap, and counts from this score
_OVERLAP, _SCORE = 0.4, 0.3
#: where more of all candidates count, that one fits the person says nothing
_MOST = 0.25
#: cells from a candidate's own cell to its middle, the median
_FAR_CELLS = 3.0
_TOLERANCE = 1e-3
#: a class is this certain somewhere, or less than this at half of all places
_CERTAIN, _IMPOSSIBLE = 0.5, 0.05
#: share of the candidates whose boxes may be infinite: sizes are exponentials, and those of nothing may run over
_MOST_NOWHERE = 0.5


@dataclass(frozen=True, slots=True)
class Verdict:
    """refused: why the layout cannot be right; None: it can. silent: the outputs are the same everywhere.

    person: the best score of a box that fits the person, 0 if there is none. label: that box's class, as the
    network counts. boxes: of any class, from the score that counts. doubt: what makes another head likely,
    one that gives more than boxes and classes; None: nothing does.
    """

    refused: str | None = None
    silent: bool = False
    person: float = 0.0
    label: int | None = None
    boxes: int = 0
    doubt: str | None = None


@lru_cache(maxsize=1)
def trial_picture() -> NDArray[np.uint8]:
    """uint8 (384, 640, 3) RGB."""
    return read_picture(_PICTURE)


def try_out(session: Session, proposal: Proposal, facts: Facts) -> Verdict:
    """Run a model as a proposal says, and see whether what comes out can be that."""
    preparation = preparation_of(proposal.layout, facts)
    placed, placement = preparation.place(trial_picture())
    outputs = one_picture(session.run(preparation.inputs([placed])))
    size = (placed.shape[1], placed.shape[0])
    for name, value in outputs.items():
        if value.dtype.kind == "f" and value.size and not np.isfinite(value).any():
            return Verdict(refused=f"it says NaN of the trial picture (in {name})")
    if all(_is_level(value) for value in outputs.values() if value.size):
        return Verdict(silent=True)
    try:
        found = decode(outputs, size, proposal.layout, None, -np.inf)
    except (ValueError, IndexError, TypeError) as error:
        return Verdict(refused=f"its outputs do not have the shapes for it ({str(error)[:80]})")
    wrong = _impossible(found, outputs, size, proposal)
    if wrong is not None:
        return Verdict(refused=wrong)
    seen = _seen(found, placement.image_from_input(found.boxes), outputs, size, proposal.layout)
    return replace(seen, doubt=_doubt(outputs, proposal.layout))


def _is_level(values: NDArray[Any]) -> bool:
    """Whether all are one finite number."""
    return bool((values == values.flat[0]).all() and np.isfinite(values.flat[0]))


def takes_batches(session: Session, found: Layout, preparation: Preparation, axis: object) -> bool:
    """Whether a model says the same of two pictures at once as of each alone.

    axis: the size of its batch axis; a number is no choice. Networks that choose among their boxes themselves
    mix the pictures of a batch.
    """
    if isinstance(axis, int) or isinstance(found.output, Chosen) or found.input.axes not in ("nchw", "nhwc"):
        return False
    if isinstance(found.output, Pairs) and found.output.selected is not None:
        return False
    pictures = [trial_picture(), np.ascontiguousarray(trial_picture()[::-1])]
    placed = [preparation.place(picture)[0] for picture in pictures]
    try:
        both = session.run(preparation.inputs(placed))
    except InputError:
        return False
    for number, picture in enumerate(placed):
        alone = one_picture(session.run(preparation.inputs([picture])))
        together = one_picture(both, number, 2)
        for name, value in alone.items():
            if together[name].shape != value.shape or not np.allclose(
                together[name].astype(np.float64),
                value.astype(np.float64),
                rtol=1e-2,
                atol=1e-2,
                equal_nan=True,
            ):
                return False
    return True


def preparation_of(layout: Layout, facts: Facts) -> Preparation:
    """How the pictures for a layout are prepared. Raises InputError if the model lacks the inputs it names."""
    by_name = {t.name: t for t in facts.signature.inputs}
    for name in (layout.input.tensor, *(s.tensor for s in layout.sizes)):
        if name not in by_name:
            raise InputError("layout: its inputs", repr(name), f"one of the model's, {', '.join(by_name)}")
    size = facts.size
    if isinstance(layout.input.size, tuple):
        size = layout.input.size
    elif layout.input.size == "picture":
        size = None
    picture = by_name[layout.input.tensor]
    dtypes = tuple(by_name[s.tensor].dtype for s in layout.sizes)
    return Preparation(layout.input, layout.sizes, dtypes, size, picture.dtype)


def one_picture(outputs: Outputs, number: int = 0, count: int = 1) -> dict[str, NDArray[Any]]:
    """The outputs of one picture of a batch, without the batch axis."""
    single = {}
    for name, value in outputs.items():
        # a batch axis of one before a lone axis may also be one object: lists keep it as it is flattened
        single[name] = value[number] if value.ndim >= 2 and value.shape[0] == count else value
    return single


def _impossible(found: Candidates, outputs: Outputs, size: tuple[int, int], proposal: Proposal) -> str | None:
    finite = np.isfinite(found.scores)
    if not finite.all() and not finite.any():
        return "it says NaN of the trial picture"
    nowhere = int((~np.isfinite(found.boxes).all(axis=1)).sum())
    if nowhere > _MOST_NOWHERE * len(found.boxes):
        return f"{nowhere} of {len(found.boxes)} boxes would be NaN or infinite"
    scores = found.scores[finite]
    if scores.size and (scores.min() < -_TOLERANCE or scores.max() > 1.0 + _TOLERANCE):
        return f"scores would be {scores.min():.3g} to {scores.max():.3g}, not 0 to 1"
    for check in (_objectness, _shares, _upright, _pixels, _classes):
        wrong = check(found, outputs, size, proposal)
        if wrong is not None:
            return wrong
    return _beside_cells(found, size, proposal)


def _objectness(found: Candidates, outputs: Outputs, _: tuple[int, int], proposal: Proposal) -> str | None:
    """YOLOv6 writes 1 where the others write an objectness."""
    output = proposal.layout.output
    if not isinstance(output, Rows) or not output.objectness:
        return None
    values = outputs[output.tensor]
    column = values[:, 4] if output.order == "rows" else values[4]
    ones = bool((column == 1).all())
    if ones and proposal.name != "yolov6" and proposal.grid:
        return "its objectness is 1 everywhere"
    if not ones and proposal.name == "yolov6":
        return "its objectness is not 1 everywhere"
    return None


def _shares(_: Candidates, outputs: Outputs, __: tuple[int, int], proposal: Proposal) -> str | None:
    """Whether every column of a row that is read as a score is one: angles, masks' weights, key points are not."""
    output = proposal.layout.output
    if not isinstance(output, Rows) or output.activation != "none":
        return None
    values = outputs[output.tensor]
    columns = np.asarray(values[:, 4:] if output.order == "rows" else values[4:].T, np.float64)
    low, high = columns.min(axis=0, initial=0.0), columns.max(axis=0, initial=1.0)
    (odd,) = np.nonzero((low < -_TOLERANCE) | (high > 1.0 + _TOLERANCE))
    if not len(odd):
        return None
    first = int(odd[0])
    return f"scores would be {low[first]:.3g} to {high[first]:.3g}, not 0 to 1 (value {first + 5} of a row)"


def _doubt(outputs: Outputs, layout: Layout) -> str | None:
    """Whether the last value of a row, read as the certainty of a class, could as well be a small angle.

    Shapes say nothing: with an objectness, one value more or less is a class. A class is somewhere certain, or
    nearly everywhere impossible.
    """
    output = layout.output
    if not isinstance(output, Rows) or not output.objectness or output.activation != "none":
        return None
    values = outputs[output.tensor]
    last = np.asarray(values[:, -1] if output.order == "rows" else values[-1], np.float64)
    if not last.size or last.max() >= _CERTAIN or np.median(last) <= _IMPOSSIBLE:
        return None
    return (
        f"the last value of its rows is {last.min():.2g} to {last.max():.2g} everywhere, as an angle may be"
    )


def _upright(found: Candidates, *_: object) -> str | None:
    """Whether boxes that count have their corners in order; all, if none counts."""
    likely = found.boxes[found.scores >= _SCORE]
    likely = likely if len(likely) else found.boxes
    turned = (likely[:, 2] < likely[:, 0] - _TOLERANCE) | (likely[:, 3] < likely[:, 1] - _TOLERANCE)
    if likely.size and turned.mean() > 0.2:
        return f"{turned.sum()} of {len(likely)} boxes would end before they begin"
    return None


def _pixels(found: Candidates, outputs: Outputs, size: tuple[int, int], proposal: Proposal) -> str | None:
    """Whether boxes that count are in the unit that they are said to be in."""
    output, likely = proposal.layout.output, found.boxes[found.scores >= _SCORE]
    if not likely.size:
        return None
    unit = getattr(output, "unit", "pixels")
    if unit == "pixels" and np.abs(likely).max() <= 2.0:
        return "boxes would be smaller than two pixels: shares of the picture?"
    if unit == "shares" and np.median(np.abs(likely).max(axis=1)) > 4.0 * max(size):
        return "boxes would be many times the picture: pixels?"
    return None


def _classes(found: Candidates, outputs: Outputs, _: tuple[int, int], proposal: Proposal) -> str | None:
    """Whether a column of classes holds whole numbers, and that of the picture in its batch 0."""
    output = proposal.layout.output
    if not isinstance(output, Chosen) or output.rows is None:
        return None
    table = outputs[output.rows].reshape(-1, len(output.columns))
    for name in {"class", "picture"} & set(output.columns):
        column = table[:, output.columns.index(name)]
        if not (column == np.rint(column)).all() or (name == "picture" and column.any()):
            return f"the column of its {name} would be {column.min():.3g} to {column.max():.3g}"
    return None


def _beside_cells(found: Candidates, size: tuple[int, int], proposal: Proposal) -> str | None:
    """Whether boxes lie beside the cells that they come from; of those that count, or else of all."""
    if not proposal.grid:
        return None
    cells, stride = grid(*size, proposal.grid)
    cells, stride = _with_anchors(cells, stride, proposal)
    centres = (found.boxes[:, :2] + found.boxes[:, 2:]) / 2.0
    away = np.abs(centres / stride[found.place] - 0.5 - cells[found.place]).max(axis=1)
    likely = found.scores >= _SCORE
    median = float(np.median(away[likely] if likely.any() else away))
    return (
        None if median <= _FAR_CELLS else f"boxes would lie {median:.0f} cells from the cells they come from"
    )


def _with_anchors(cells: FloatArray, stride: FloatArray, proposal: Proposal) -> tuple[FloatArray, FloatArray]:
    """Each stride's cells once for each anchor."""
    parts = [np.flatnonzero(stride[:, 0] == s) for s in proposal.grid]
    order = np.concatenate([np.tile(part, proposal.anchors) for part in parts])
    return cells[order], stride[order]


def _seen(
    found: Candidates, boxes: FloatArray, outputs: Outputs, size: tuple[int, int], layout: Layout
) -> Verdict:
    likely = np.flatnonzero(found.scores >= _SCORE)
    if not likely.size:
        return Verdict()
    if not isinstance(layout.output, Chosen) and likely.size > _MOST * found.scores.size:
        return Verdict(boxes=int(likely.size))
    overlap = np.max([iou(person, boxes[likely]) for person in _PEOPLE], axis=0)
    fitting = likely[overlap >= _OVERLAP]
    if not fitting.size:
        return Verdict(boxes=int(likely.size))
    best = int(fitting[found.scores[fitting].argmax()])
    label = _label(outputs, size, layout, best)
    return Verdict(person=float(found.scores[best]), label=label, boxes=int(likely.size))


def _label(outputs: Outputs, size: tuple[int, int], layout: Layout, candidate: int) -> int | None:
    """The class of a candidate, where the network gives classes as numbers."""
    if not isinstance(layout.output, Chosen):
        return None
    for label in range(256):
        some = decode(outputs, size, layout, ((label,),), -np.inf)
        if candidate in some.place:
            return label
    return None

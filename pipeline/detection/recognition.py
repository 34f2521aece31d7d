"""Which layout a model has: by its names, shapes, types, metadata, graph, and a trial picture.

Where two fit equally nobody guesses: the question is an InputError with the ``layout:`` section filled in as
far as could be seen.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.config.layout import Layout, Rows, SizeInput
from pipeline.detection.class_names import COCO_80, COCO_91, PERSON
from pipeline.detection.facts import Facts, Signature, Tensor, is_float, is_whole, metadata_names
from pipeline.detection.graph import class_count
from pipeline.detection.layouts import proposals
from pipeline.detection.layouts.proposal import Proposal, picture_input
from pipeline.detection.session import Session
from pipeline.detection.trial import Verdict, preparation_of, trial_picture, try_out
from pipeline.errors import InputError

#: a rival must be so much surer of the person in the trial picture
_SURER = 0.15
_USUAL_SIDE = 640


@dataclass(frozen=True, slots=True)
class Recognised:
    """name: of the layout. names: of the network's classes, from ``layout.first_class``. why, assumed: said."""

    name: str
    layout: Layout
    facts: Facts
    names: tuple[str, ...]
    why: tuple[str, ...]
    assumed: tuple[str, ...]


class LayoutQuestionError(InputError):
    """A model whose layout is not known; the section to fill in comes with it, line by line."""

    def __init__(self, where: object, found: str, expected: str, section: str = "") -> None:
        super().__init__(where, found, expected)
        self.details = section

    def __reduce__(self) -> tuple[type[LayoutQuestionError], tuple[str, str, str, str]]:  # type: ignore[override]
        return type(self), (self.where, self.found, self.expected, self.details)


def recognise(
    session: Session,
    path: Path,
    *,
    asked: str | Layout | None = None,
    names: tuple[str, ...] | None = None,
    size: tuple[int, int] | None = None,
) -> Recognised:
    """The layout of an open model.

    asked: what the pool says, the name of a layout or a description. names: of the classes, by the pool.
    size: width and height of the input, by the pool, where the model leaves them free.
    Raises InputError for a model that cannot be used, LayoutQuestionError where it is not certain.
    """
    try:
        facts = gather(session, path, names, size)
        if isinstance(asked, Layout):
            described = Proposal(
                "described", asked, ("the pool describes it",), _described_classes(asked, facts)
            )
            return _named(path, described, facts, _possible(path, session, described, facts))
        return _chosen(session, path, facts, asked)
    except LayoutQuestionError:
        raise
    except InputError as error:
        raise (
            error
            if error.where.startswith(str(path))
            else InputError(f"{path}: {error.where}", error.found, error.expected)
        ) from None


def _possible(path: Path, session: Session, proposal: Proposal, facts: Facts) -> Verdict:
    verdict = try_out(session, proposal, facts)
    if verdict.refused is not None:
        raise InputError(f"{path} layout", verdict.refused, "a description that fits the model's outputs")
    return verdict


def _chosen(session: Session, path: Path, facts: Facts, asked: str | None) -> Recognised:
    found = list(proposals(facts))
    if asked is not None:
        named = [p for p in found if p.name == asked]
        if not named:
            others = ", ".join(p.name for p in found) or "none of the built-in ones"
            raise LayoutQuestionError(
                f"{path} layout", repr(asked), f"one that fits its shapes: {others}", section_of(facts, None)
            )
        return _named(path, named[0], facts, _possible(path, session, named[0], facts))
    tried = [(p, try_out(session, p, facts)) for p in found]
    fitting = [(p, v) for p, v in tried if v.refused is None]
    if not fitting:
        reasons = "; ".join(f"not {p.name}, since {v.refused}" for p, v in tried)
        raise LayoutQuestionError(
            path,
            f"a model of no known layout ({facts.signature}{'; ' + reasons if reasons else ''})",
            "one of the known layouts, or this section in the pool, completed:",
            section_of(facts, None),
        )
    fitting = _by_class_count(fitting, facts)
    proposal, verdict = _surest(path, fitting, facts)
    return _named(path, proposal, facts, verdict)


def _by_class_count(fitting: list[tuple[Proposal, Verdict]], facts: Facts) -> list[tuple[Proposal, Verdict]]:
    """Those whose classes are as many as the names, if any are."""
    if facts.names is None:
        return fitting
    same = [(p, v) for p, v in fitting if p.classes in (None, len(facts.names))]
    return same or fitting


def _surest(path: Path, fitting: list[tuple[Proposal, Verdict]], facts: Facts) -> tuple[Proposal, Verdict]:
    """The usual one, or the one that sees the person in the trial picture much better than the rest."""
    ranked = sorted(fitting, key=lambda pv: (-pv[1].person, not pv[0].usual))
    best = ranked[0]
    if best[1].person > 0.0 and all(best[1].person >= v.person + _SURER for p, v in ranked[1:]):
        return best
    usual = [pv for pv in fitting if pv[0].usual] or fitting
    sure = max(v.person for _, v in fitting)
    near = [pv for pv in usual if pv[1].person > sure - _SURER]
    if len(near) == 1:
        return near[0]
    listed = " or ".join(p.name for p, _ in near or usual)
    raise LayoutQuestionError(
        path,
        f"a model that fits several layouts equally, {listed} ({facts.signature})",
        f"layout: with one of these names in the pool, or a section such as this for {(near or usual)[0][0].name}:",
        section_of(facts, (near or usual)[0][0]),
    )


def _named(path: Path, proposal: Proposal, facts: Facts, verdict: Verdict) -> Recognised:
    names, assumed = _names(path, proposal, facts, verdict)
    said = list(proposal.assumed) + assumed
    if facts.size_from.startswith("assumed"):
        said.append(f"an input of {facts.width} x {facts.height}, which the model leaves open")
    if verdict.silent:
        said.append("that it works: its outputs do not depend on the place, with the trial picture at least")
    why = (*proposal.why, *_seen(verdict))
    return Recognised(proposal.name, proposal.layout, facts, names, why, tuple(said))


def _seen(verdict: Verdict) -> tuple[str, ...]:
    if verdict.person:
        return (f"it finds the person in the trial picture with score {verdict.person:.2f}",)
    if verdict.boxes:
        return (f"no box of the {verdict.boxes} in the trial picture fits its person",)
    return ("it finds nothing in the trial picture, which shows a person close by",)


def _names(
    path: Path, proposal: Proposal, facts: Facts, verdict: Verdict
) -> tuple[tuple[str, ...], list[str]]:
    count = proposal.classes or facts.class_count
    first = proposal.layout.first_class
    names = facts.names
    if names is not None:
        if count is not None and len(names) != count:
            raise InputError(
                f"{path} names",
                f"{len(names)} names for {count} classes",
                "one for each class; a head that gives more than boxes and classes is not read"
                " (rotated boxes, masks, poses)",
            )
        return names, []
    if count == len(COCO_80):
        return COCO_80, ["the names of COCO's 80 classes, since it has 80 and says no names"]
    if count == len(COCO_91):
        return COCO_91, ["the names of COCO's classes by their 91 numbers, since it has as many"]
    if count == 1:
        return (PERSON,), ["that its one class is a person, since it says no name"]
    persons = (0,) if first == 0 else (1,)
    if count is None and verdict.label in persons:
        said = (
            f"COCO's names: it calls the person in the trial picture class {verdict.label}, and says no names"
        )
        return (COCO_80 if first == 0 else COCO_91[1:]), [said]
    raise LayoutQuestionError(
        f"{path} names",
        f"a {proposal.name} of {count if count is not None else 'an unknown number of'} classes without names",
        "names: in the pool, its classes in order (or coco, coco91)",
        section_of(facts, proposal) + "\nnames: [?]",
    )


def _described_classes(layout: Layout, facts: Facts) -> int | None:
    shapes = {t.name: t.shape for t in facts.outputs}
    output = layout.output
    if isinstance(output, Rows) and output.tensor in shapes and len(shapes[output.tensor]) == 2:
        values = shapes[output.tensor][1 if output.order == "rows" else 0]
        return int(values or 0) - (5 if output.objectness else 4)
    return None


def gather(
    session: Session,
    path: Path,
    names: tuple[str, ...] | None = None,
    input_size: tuple[int, int] | None = None,
) -> Facts:
    """Everything that a model shows, its outputs for the trial picture among it.

    Raises InputError if it takes no picture, or fails on one.
    """
    signature = session.signature
    picture, axes = picture_of(signature)
    size, size_from = _size(picture, axes, signature, input_size)
    known = names or metadata_names(signature.metadata)
    shapes = {t.name: tuple(s if isinstance(s, int) else 1 for s in t.shape) for t in signature.outputs}
    facts = Facts(signature, picture, axes, size, size_from, shapes, {}, known)
    values = _first_run(session, facts)
    shapes = {name: value.shape for name, value in values.items()}
    count = None
    if any(is_whole(t) for t in signature.outputs) and known is None:
        count = class_count(path.read_bytes())
    return replace(facts, shapes=shapes, values=values, class_count=count)


def _first_run(session: Session, facts: Facts) -> dict[str, NDArray[Any]]:
    """The outputs for the trial picture with the plainest preparation."""
    sizes = tuple(
        SizeInput(tensor=t.name, value="ones" if is_float(t) else "width_height")
        for t in facts.others
        if t.shape[-1:] == (2,)
    )
    layout = Layout(
        input=picture_input(facts, placement="letterbox_centred"),
        sizes=sizes,
        output=Rows(tensor="-"),
    )
    preparation = preparation_of(layout, facts)
    placed, _ = preparation.place(trial_picture())
    inputs = preparation.inputs([placed])
    for tensor in facts.others:
        if tensor.name not in inputs:
            shape = tuple(s if isinstance(s, int) else 1 for s in tensor.shape)
            inputs[tensor.name] = np.zeros(shape, tensor.dtype)
    return session.run(inputs)


def picture_of(signature: Signature) -> tuple[Tensor, str]:
    """The input for the picture and the order of its axes. Raises InputError if there is none, or several."""
    found = [(t, axes) for t in signature.inputs if (axes := _axes(t)) is not None]
    if len(found) != 1:
        kind = "no input" if not found else f"{len(found)} inputs"
        shown = ", ".join(map(str, signature.inputs)) or "nothing"
        expected = "one input such as (1, 3, height, width)"
        raise InputError("its inputs", f"{kind} that can be a picture ({shown})", expected)
    tensor, axes = found[0]
    if tensor.dtype not in ("uint8", "float16", "float32", "float64"):
        raise InputError("its inputs", str(tensor), "a picture as uint8, float16 or float32")
    return tensor, axes


def _axes(tensor: Tensor) -> str | None:
    """The order of the axes of a picture, by where its three colours are (or the one of a grey picture)."""
    shape = tensor.shape
    named = {3: ("chw", "", "hwc"), 4: ("", "nchw", "", "nhwc")}.get(len(shape), ())
    for colours in (3, 1):
        for axis, order in enumerate(named):
            if order and shape[axis] == colours and (colours == 3 or len(shape) == 4):
                return order
    free = len(shape) == 4 and all(not isinstance(size, int) for size in shape[1:])
    return "nchw" if free else None


def _size(
    picture: Tensor, axes: str, signature: Signature, wanted: tuple[int, int] | None
) -> tuple[tuple[int, int] | None, str]:
    high, wide = picture.shape[-2:] if axes.endswith("chw") else picture.shape[-3:-1]
    if isinstance(high, int) and isinstance(wide, int):
        if wanted not in (None, (wide, high)):
            raise InputError("input_size", f"{wanted}", f"{wide}, {high}, which the model fixes")
        return (wide, high), "the model"
    if wanted is not None:
        return wanted, "the pool (input_size)"
    stated = _stated_size(signature)
    if stated is not None:
        return stated, "its metadata (imgsz)"
    if axes != "nchw":
        return None, "the picture: a model in rows and columns, or without a batch, resizes it itself"
    return (
        wide if isinstance(wide, int) else _USUAL_SIDE,
        high if isinstance(high, int) else _USUAL_SIDE,
    ), "assumed"


def _stated_size(signature: Signature) -> tuple[int, int] | None:
    """Width and height of Ultralytics' ``imgsz``, which is height, width."""
    try:
        sides = ast.literal_eval(signature.metadata.get("imgsz", ""))
        high, wide = (sides, sides) if isinstance(sides, int) else sides
        return (int(wide), int(high)) if 0 < int(wide) <= 16384 and 0 < int(high) <= 16384 else None
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return None


def section_of(facts: Facts, proposal: Proposal | None) -> str:
    """The ``layout:`` section for the pool as YAML, as far as it is known; the rest is marked with ?."""
    if proposal is not None:
        return layout_yaml(proposal.layout)
    picture = picture_input(facts).model_dump(mode="json", exclude_none=True)
    unknown = {"colour": "?", "range": "?", "placement": "?"}
    shown = ", ".join(f"{t.name} {list(facts.shapes[t.name])}" for t in facts.signature.outputs)
    document: dict[str, Any] = {"input": picture | unknown}
    if facts.others:
        document["sizes"] = [{"tensor": t.name, "value": "?"} for t in facts.others]
    document["output"] = _guessed_output(facts)
    text = yaml.safe_dump({"layout": document}, sort_keys=False, default_flow_style=None, allow_unicode=True)
    kinds = "# kinds of output: rows, pairs, chosen, distances, anchors, cells; ? is to be filled in"
    return f"# outputs: {shown}\n{kinds}\n{text.rstrip()}"


def _guessed_output(facts: Facts) -> dict[str, Any]:
    """What the shapes of the outputs look like most."""
    outputs = facts.outputs
    if len(outputs) == 1 and len(outputs[0].shape) >= 2:
        high, wide = outputs[0].shape[-2:]
        order = "rows" if int(high or 0) >= int(wide or 0) else "columns"
        return {"kind": "rows", "tensor": outputs[0].name, "order": order, "box": "?", "objectness": "?"}
    boxes = [t.name for t in outputs if t.shape[-1:] == (4,)]
    if len(outputs) == 2 and len(boxes) == 1:
        (scores,) = (t.name for t in outputs if t.name not in boxes)
        unknown = {"box": "?", "unit": "?", "activation": "?"}
        return {"kind": "pairs", "boxes": boxes[0], "scores": scores} | unknown
    return {"kind": "?", "tensors": [t.name for t in outputs]}


def layout_yaml(layout: Layout) -> str:
    """A layout as the pool has it."""
    document = {"layout": layout.model_dump(mode="json", exclude_none=True)}
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, allow_unicode=True).rstrip()


def listed(found: Sequence[str]) -> str:
    """Sentences, one a line."""
    return "\n".join(f"  {sentence}" for sentence in found)

"""Everything that an open model shows of itself: inputs, outputs, metadata, and what it says of a first picture."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.config.layout import Layout, Rows, SizeInput
from pipeline.detection.facts import Facts, Signature, Tensor, is_float, is_whole, metadata_names
from pipeline.detection.graph import class_count
from pipeline.detection.layouts.proposal import picture_input
from pipeline.detection.session import Session
from pipeline.detection.trial import preparation_of, trial_picture
from pipeline.errors import InputError

_USUAL_SIDE = 640


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

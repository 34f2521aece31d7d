"""What a model says of itself: its tensors, its metadata, and what it gave for a first picture."""

from __future__ import annotations

import ast
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Axis = int | str | None


@dataclass(frozen=True, slots=True)
class Tensor:
    """One input or output. shape: a free axis is its name or None. dtype: numpy's name, such as float32."""

    name: str
    shape: tuple[Axis, ...]
    dtype: str

    def __str__(self) -> str:
        sizes = ", ".join("?" if size is None else str(size) for size in self.shape)
        return f"{self.name} {self.dtype}[{sizes}]"


@dataclass(frozen=True, slots=True)
class Signature:
    """What a model takes and gives, in its order, and its metadata."""

    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]
    metadata: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        takes, gives = (", ".join(map(str, tensors)) for tensors in (self.inputs, self.outputs))
        return f"takes {takes}; gives {gives}"


@dataclass(frozen=True, slots=True, eq=False)
class Facts:
    """All that recognition goes by.

    picture: the input for the picture; axes: its order; size: its width and height, as the model fixes them
    or as they were chosen (why, in ``size_from``); None: it takes pictures as they come. shapes: of the
    outputs, as they came out for the trial picture (as declared where it could not be run). classes: names
    from metadata, or from the pool. class_count: by the graph, where labels come out instead of scores.
    """

    signature: Signature
    picture: Tensor
    axes: str
    size: tuple[int, int] | None
    size_from: str
    shapes: Mapping[str, tuple[int, ...]]
    values: Mapping[str, NDArray[Any]]
    names: tuple[str, ...] | None = None
    class_count: int | None = None

    @property
    def metadata(self) -> Mapping[str, str]:
        """The exporter's."""
        return self.signature.metadata

    @property
    def others(self) -> tuple[Tensor, ...]:
        """Inputs beside the picture."""
        return tuple(t for t in self.signature.inputs if t.name != self.picture.name)

    @property
    def outputs(self) -> tuple[Tensor, ...]:
        """The outputs with the shapes that they have, one picture at a time: a batch axis of 1 is left out."""
        return tuple(
            Tensor(t.name, without_batch(self.shapes[t.name]), t.dtype) for t in self.signature.outputs
        )

    @property
    def width(self) -> int:
        """Of the input; 640 where it is not fixed."""
        return self.size[0] if self.size else 640

    @property
    def height(self) -> int:
        """Of the input; 640 where it is not fixed."""
        return self.size[1] if self.size else 640

    def cells(self, *strides: int) -> int:
        """Cells of all the strides together."""
        return sum(-(-self.height // s) * -(-self.width // s) for s in strides)


def without_batch(shape: tuple[int, ...]) -> tuple[int, ...]:
    """A shape without a batch axis of 1 before two or more others, or before one of more than one."""
    return shape[1:] if len(shape) >= 2 and shape[0] == 1 else shape


def metadata_names(metadata: Mapping[str, str]) -> tuple[str, ...] | None:
    """Class names that an exporter wrote: a dictionary or list in ``names``, or words in ``classes``."""
    text = metadata.get("names") or metadata.get("classes") or metadata.get("labels")
    if not text:
        return None
    found: Any = None
    for parse in (ast.literal_eval, json.loads):
        try:
            found = parse(text)
            break
        except (ValueError, SyntaxError, MemoryError, RecursionError, TypeError):
            continue
    if isinstance(found, dict):
        try:
            numbered = {int(key): str(name) for key, name in found.items()}
        except (TypeError, ValueError):
            return None
        return tuple(numbered.get(k, f"class {k}") for k in range(max(numbered, default=-1) + 1)) or None
    if isinstance(found, list | tuple):
        return tuple(map(str, found)) or None
    words = tuple(word.strip() for word in text.replace("\n", ",").split(",") if word.strip())
    return words or None


def is_float(tensor: Tensor) -> bool:
    """Whether it holds fractions."""
    return tensor.dtype.startswith(("float", "bfloat", "double"))


def is_whole(tensor: Tensor) -> bool:
    """Whether it holds whole numbers."""
    return tensor.dtype.startswith(("int", "uint"))


def float_values(facts: Facts, name: str) -> NDArray[np.float64] | None:
    """What an output was for the trial picture, without a batch axis of 1; None where it was not run."""
    value = facts.values.get(name)
    if value is None:
        return None
    return np.asarray(value, np.float64).reshape(without_batch(value.shape))

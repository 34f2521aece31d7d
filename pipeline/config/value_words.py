"""The types of the schema in words: what a key may be, its default, and how it may be written."""

from __future__ import annotations

import json
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import annotated_types
from pydantic import BeforeValidator
from pydantic.fields import FieldInfo

from pipeline.config.base import Strict
from pipeline.config.stream_url import StreamUrl
from pipeline.config.units import Quantity

_PLAIN = {
    bool: "`true` or `false`",
    int: "whole number",
    float: "number",
    str: "text",
    Path: "path",
    StreamUrl: "URL",
    Any: "anything",
}
_UNIONS = (Union, types.UnionType)


def values_of(hint: Any, field: FieldInfo, link_to: Callable[[type[Strict]], str]) -> str:
    """What a field may be, in Markdown."""
    return _values(hint, field.metadata, link_to)


def _values(hint: Any, metadata: list[Any], link_to: Callable[[type[Strict]], str]) -> str:
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        quantity = _quantity(list(parts[1:]))
        return _quantity_words(quantity) if quantity else _values(parts[0], [*parts[1:], *metadata], link_to)
    if origin in _UNIONS:
        return " or ".join(_values(part, metadata, link_to) for part in parts if part is not type(None))
    if origin is Literal:
        words = ", ".join(f"`{value}`" for value in parts)
    elif origin is tuple:
        count = "list of" if parts[1:] == (...,) else f"list of {len(parts)}:"
        words = f"{count} {_values(parts[0], [], link_to)}"
    elif origin is dict:
        words = f"keys, each with {_values(parts[1], [], link_to)}"
    elif isinstance(hint, type) and issubclass(hint, Strict):
        words = link_to(hint)
    else:
        words = _PLAIN[hint] + _range_words(metadata)
    return words


def _quantity(metadata: list[Any]) -> Quantity | None:
    return next(
        (m.func for m in metadata if isinstance(m, BeforeValidator) and isinstance(m.func, Quantity)), None
    )


def _quantity_words(quantity: Quantity) -> str:
    units = " or ".join(f"`{unit}`" for unit in quantity.units)
    first = next(iter(quantity.units.values()))
    low, high = quantity.low / first, quantity.high / first
    words = []
    if low >= 0.0:
        words.append("more than 0" if 0.0 < low < 1e-5 else f"at least {low:g}")
    if high < 1e9:
        words.append(f"at most {high:g}")
    return "; ".join((units, ", ".join(words))) if words else units


def _range_words(metadata: list[Any]) -> str:
    words = []
    for limit in _limits(metadata):
        if isinstance(limit, annotated_types.Ge):
            words.append(f"at least {limit.ge:g}")
        elif isinstance(limit, annotated_types.Gt):
            words.append(f"more than {limit.gt:g}")
        elif isinstance(limit, annotated_types.Le):
            words.append(f"at most {limit.le:g}")
        elif isinstance(limit, annotated_types.Lt):
            words.append(f"less than {limit.lt:g}")
    return "; " + ", ".join(dict.fromkeys(words)) if words else ""


def _limits(metadata: list[Any]) -> Iterator[Any]:
    for item in metadata:
        if isinstance(item, FieldInfo):
            yield from _limits(item.metadata)
        else:
            yield item


def default_of(hint: Any, field: FieldInfo) -> str:
    """The default, in Markdown: ``required``, ``absent``, or as it is written."""
    if field.is_required():
        return "required"
    default = field.get_default(call_default_factory=True)
    if default is None or default in ((), {}):
        return "absent"
    return "its defaults" if isinstance(default, Strict) else f"`{_written(hint, default)}`"


def example_of(hint: Any, field: FieldInfo, of_record: Callable[[type[Strict]], str]) -> str | None:
    """How a field may be written, as far as its type and default tell; None where they do not."""
    default = None if field.is_required() else field.get_default(call_default_factory=True)
    if isinstance(default, bool):
        return str(not default).lower()
    if default not in (None, (), {}) and not isinstance(default, Strict):
        return _written(hint, default)
    return _example_of_type(hint, of_record)


def _example_of_type(hint: Any, of_record: Callable[[type[Strict]], str]) -> str | None:
    if get_origin(hint) is Literal:
        return str(get_args(hint)[0])
    if get_origin(hint) is tuple:
        inner = _example_of_type(get_args(hint)[0], of_record)
        return inner and f"[{inner}]"
    if isinstance(hint, type) and issubclass(hint, Strict):
        return of_record(hint)
    if get_origin(hint) in _UNIONS:
        return next((e for part in get_args(hint) if (e := _example_of_type(part, of_record))), None)
    return None


def _parts(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in _UNIONS else (hint,)


def _written(hint: Any, value: Any) -> str:
    for part in _parts(hint):
        quantity = _quantity(list(get_args(part)[1:])) if get_origin(part) is Annotated else None
        if quantity is not None and isinstance(value, float):
            unit, factor = next(iter(quantity.units.items()))
            return f"{{{unit}: {value / factor:g}}}"
    if isinstance(value, tuple):
        return "[" + ", ".join(f"{v:g}" for v in value) + "]"
    if isinstance(value, bool):
        return json.dumps(value)
    return f"{value:g}" if isinstance(value, float) else str(value)

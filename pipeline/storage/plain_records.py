"""Frozen records as plain JSON and back: a record carries its class, a set and a map say what they are."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import fields, is_dataclass
from typing import Any

#: the key under which a record's class stands, and the two values of it that are no class
CLASS, SET, MAP = "@", "set", "map"


def to_plain(value: Any) -> Any:
    """What JSON can say. value: dataclasses, tuples, sets, mappings (of any keys), str, bool, int, float, None.

    Equal values give equal plain ones: sets are in an order of their own. Raises TypeError for anything else.
    """
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if is_dataclass(value) and not isinstance(value, type):
        said = {f.name: to_plain(getattr(value, f.name)) for f in fields(value) if f.init}
        return {CLASS: type(value).__name__, **said}
    if isinstance(value, tuple):
        return [to_plain(one) for one in value]
    if isinstance(value, Set):
        return {CLASS: SET, "of": sorted((to_plain(one) for one in value), key=repr)}
    if isinstance(value, Mapping):
        return {CLASS: MAP, "of": [[to_plain(key), to_plain(one)] for key, one in value.items()]}
    raise TypeError(f"a {type(value).__name__} cannot be written as plain JSON")


def from_plain(plain: Any, classes: Mapping[str, type]) -> Any:
    """The value. classes: those that may come, by name; a list is a tuple. Raises ValueError for any other class."""
    if isinstance(plain, list):
        return tuple(from_plain(one, classes) for one in plain)
    if not isinstance(plain, dict):
        return plain
    name = plain.get(CLASS)
    if name == SET:
        return frozenset(from_plain(one, classes) for one in plain["of"])
    if name == MAP:
        return {from_plain(key, classes): from_plain(one, classes) for key, one in plain["of"]}
    if not isinstance(name, str) or name not in classes:
        raise ValueError(f"a record of the class {name!r}; expected one of {', '.join(sorted(classes))}")
    try:
        return classes[name](**{k: from_plain(one, classes) for k, one in plain.items() if k != CLASS})
    except TypeError as error:
        raise ValueError(f"a {name} with other fields: {error}") from None

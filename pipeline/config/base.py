"""Strict records read from YAML; every fault is an InputError with file, line and field."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from pipeline.errors import InputError, SeveralInputsError

_MISMATCH = "mismatch"
#: of every YAML format; written by what writes them, another one is refused
FORMAT_VERSION = 1
#: what ``searchlight init`` writes where only a person can know the value
FILL_IN = "FILL IN"


def mismatch(found: str, expected: str, at: Sequence[str | int] = ()) -> PydanticCustomError:
    """What a validator raises where it knows better words than pydantic.

    at: the way from the validated value to the fault.
    """
    return PydanticCustomError(_MISMATCH, "mismatch", {"found": found, "expected": expected, "at": tuple(at)})


class Strict(BaseModel):
    """Frozen; unknown keys fail, but in the few schemas that say extra="ignore"."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _keys_are_known(cls, data: Any) -> Any:
        # before "missing": a misspelt key is both unknown and missing, and its spelling is what to look at
        if cls.model_config.get("extra") == "ignore":
            return data
        for key in data if isinstance(data, dict) else ():
            if key not in cls.model_fields:
                raise mismatch("an unknown key", "one of " + ", ".join(cls.model_fields), at=(str(key),))
        return data


S = TypeVar("S", bound=Strict)


def refuse_repeated(kind: str, names: Sequence[object], at: str) -> None:
    """Raise a mismatch at the list ``at`` if a name comes twice."""
    for number, name in enumerate(names):
        if name in names[:number]:
            raise mismatch(f"{kind} {name!r} again", f"every {kind} once", at=(at, number))


def load(path: Path, schema: type[S]) -> S:
    """The record in a YAML file. Raises InputError naming file, line and field.

    The file may say ``version: 1``, the version of its format; files from before versions say nothing.
    """
    node = _parse(path)
    document = _plain(path, node)
    _refuse_unfilled(path, node)
    version = document.pop("version", FORMAT_VERSION)
    if type(version) is not int or version != FORMAT_VERSION:
        where = f"{path}:{_line(node, ('version',))} version"
        raise InputError(where, _short(version), f"{FORMAT_VERSION}, the format that this Searchlight reads")
    try:
        return schema.model_validate(document)
    except ValidationError as error:
        raise _input_error(path, node, error.errors(include_url=False)[0]) from None


def _parse(path: Path) -> yaml.Node:
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(path, "no file", "a YAML file") from None
    except (OSError, ValueError) as error:
        raise InputError(path, f"an unreadable file ({error})", "a YAML file in UTF-8") from None
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        raise _not_yaml(path, error) from None
    except (ValueError, OverflowError, RecursionError) as error:
        # PyYAML lets these out for escapes beyond Unicode and for nesting without end
        raise InputError(path, f"text that is not YAML ({type(error).__name__})", "valid YAML") from None
    if not isinstance(node, yaml.MappingNode):
        raise InputError(path, "no mapping", "keys and values at the top of the file")
    return node


class _Loader(yaml.SafeLoader):
    """SafeLoader, but a scalar that does not fit its tag is a YAMLError with a line."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ValueError, OverflowError, LookupError, AttributeError, TypeError) as error:
            tag = node.tag.rpartition(":")[2]
            raise yaml.constructor.ConstructorError(None, None, f"not a {tag}", node.start_mark) from error


def _plain(path: Path, node: yaml.Node) -> Any:
    try:
        _refuse_duplicates(path, node, set())
        return _Loader("").construct_document(node)
    except yaml.YAMLError as error:
        raise _not_yaml(path, error) from None
    except RecursionError:
        raise InputError(path, "nesting without end", "a few levels") from None


def _not_yaml(path: Path, error: yaml.YAMLError) -> InputError:
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or str(error).splitlines()[0]
    where = f"{path}:{mark.line + 1}" if mark else path
    return InputError(where, f"text that is not YAML ({_one_line(problem)})", "valid YAML")


def _refuse_duplicates(path: Path, node: yaml.Node, visited: set[int]) -> None:
    if id(node) in visited:
        return  # an alias: it may double what it contains line by line, or contain itself
    visited.add(id(node))
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _refuse_duplicates(path, item, visited)
    if isinstance(node, yaml.MappingNode):
        keys: set[str] = set()
        for key, value in node.value:
            _require_new_key(path, key, keys)
            _refuse_duplicates(path, value, visited)


def _refuse_unfilled(path: Path, node: yaml.Node) -> None:
    faults = tuple(
        InputError(f"{path}:{line} {'.'.join(way)}", FILL_IN, "a value in its place: only you can know it")
        for way, line in _unfilled(node, (), set())
    )
    if faults:
        raise SeveralInputsError(faults) if faults[1:] else faults[0]


def _unfilled(
    node: yaml.Node, way: tuple[str, ...], visited: set[int]
) -> Iterator[tuple[tuple[str, ...], int]]:
    """The way to, and the line of, every value that is still to be filled in."""
    if id(node) in visited:
        return  # an alias, as above
    visited.add(id(node))
    if isinstance(node, yaml.ScalarNode) and node.value == FILL_IN:
        yield way, node.start_mark.line + 1
    if isinstance(node, yaml.SequenceNode):
        for number, item in enumerate(node.value):
            yield from _unfilled(item, (*way, str(number)), visited)
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            yield from _unfilled(value, (*way, _one_line(str(key.value))), visited)


def _require_new_key(path: Path, key: yaml.Node, keys: set[str]) -> None:
    where = f"{path}:{key.start_mark.line + 1}"
    if not isinstance(key, yaml.ScalarNode):
        raise InputError(where, "a key that is a list or a mapping", "a name as the key")
    if key.value in keys:
        raise InputError(f"{where} {_one_line(key.value)}", "the key twice", "it once")
    keys.add(key.value)


def _input_error(path: Path, node: yaml.Node, fault: ErrorDetails) -> InputError:
    context = fault.get("ctx", {})
    way = (*fault["loc"], *context.get("at", ()))
    field = ".".join(_one_line(str(key)) for key in way)
    where = f"{path}:{_line(node, way)} {field}".rstrip()
    if fault["type"] == _MISMATCH:
        return InputError(where, _one_line(context["found"]), _one_line(context["expected"]))
    if fault["type"] == "missing":
        return InputError(where, "nothing", "a value")
    if fault["type"] == "string_pattern_mismatch":
        return InputError(where, _short(fault["input"]), f"text of the pattern {context['pattern']}")
    if fault["type"] in ("model_type", "model_attributes_type"):
        return InputError(where, _short(fault["input"]), "keys and values")
    return InputError(where, _short(fault["input"]), _expected(fault["msg"]))


def _expected(message: str) -> str:
    message = re.sub(r"^(Value error, )?(expected )?", "", message)
    message = re.sub(r"^(Input|String|Tuple|List|Dictionary|Value) should (be |have )?", "", message)
    message = re.sub(r" after validation, not \d+$", "", message)
    return message[:1].lower() + message[1:]


def _short(value: object) -> str:
    limits = reprlib.Repr()
    limits.maxlevel, limits.maxdict, limits.maxlist, limits.maxstring, limits.maxother = 2, 3, 3, 60, 60
    return _one_line(limits.repr(value))


def _one_line(text: str) -> str:
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text[:200])


def _line(node: yaml.Node | None, way: Sequence[str | int]) -> int:
    """The line of the deepest part of the way that the file has."""
    line = node.start_mark.line if node is not None else 0
    for key in way:
        found = _child(node, key)
        if found is None:
            break
        node, line = found
    return line + 1


def _child(node: yaml.Node | None, key: str | int) -> tuple[yaml.Node, int] | None:
    if isinstance(node, yaml.SequenceNode) and isinstance(key, int) and key < len(node.value):
        return node.value[key], node.value[key].start_mark.line
    if isinstance(node, yaml.MappingNode):
        for name, value in node.value:
            if name.value == str(key):
                return value, name.start_mark.line
    return None

"""Strict records read from YAML; every fault is an InputError with file, line and field."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from pipeline.errors import InputError


class Strict(BaseModel):
    """Frozen; unknown keys fail."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=True)


S = TypeVar("S", bound=Strict)


def load(path: Path, schema: type[S]) -> S:
    """The record in a YAML file. Raises InputError naming file, line and field."""
    node = _parse(path)
    try:
        return schema.model_validate(_plain(path, node))
    except ValidationError as error:
        raise _first_fault(path, node, error) from None


def _parse(path: Path) -> yaml.Node:
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(path, "no file", "a YAML file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"an unreadable file ({error})", "a YAML file in UTF-8") from None
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise InputError(f"{path}{line}", f"text that is not YAML ({problem})", "valid YAML") from None
    if not isinstance(node, yaml.MappingNode):
        raise InputError(path, "no mapping", "keys and values at the top of the file")
    return node


def _plain(path: Path, node: yaml.Node) -> Any:
    _refuse_duplicates(path, node)
    loader = yaml.SafeLoader("")
    try:
        return loader.construct_document(node)  # type: ignore[no-untyped-call]
    except yaml.YAMLError as error:
        raise InputError(path, f"text that is not plain YAML ({error})", "valid YAML") from None


def _refuse_duplicates(path: Path, node: yaml.Node) -> None:
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _refuse_duplicates(path, item)
    if isinstance(node, yaml.MappingNode):
        seen: set[str] = set()
        for key, value in node.value:
            if key.value in seen:
                raise InputError(
                    f"{path}:{key.start_mark.line + 1} {key.value}", "the key twice", "one of them"
                )
            seen.add(key.value)
            _refuse_duplicates(path, value)


def _first_fault(path: Path, node: yaml.Node, error: ValidationError) -> InputError:
    fault = error.errors(include_url=False)[0]
    location, line = [], node.start_mark.line + 1
    here: yaml.Node | None = node
    for key in fault["loc"]:
        child, child_line = _child(here, key)
        location.append(str(key))
        here = child
        if child_line is not None:
            line = child_line
    where = f"{path}:{line} {'.'.join(location)}".rstrip()
    kind, found = fault["type"], repr(fault["input"])
    found = found if len(found) <= 100 else found[:97] + "..."
    if kind == "extra_forbidden":
        return InputError(where, "an unknown key", "only keys of the schema")
    if kind == "missing":
        return InputError(where, "nothing", "this key")
    message = fault["msg"].removeprefix("Value error, ").removeprefix("expected ")
    return InputError(where, found, message[0].lower() + message[1:])


def _child(node: yaml.Node | None, key: object) -> tuple[yaml.Node | None, int | None]:
    if isinstance(node, yaml.SequenceNode) and isinstance(key, int) and key < len(node.value):
        return node.value[key], node.value[key].start_mark.line + 1
    if isinstance(node, yaml.MappingNode):
        for name, value in node.value:
            if name.value == str(key):
                return value, name.start_mark.line + 1
    return None, None

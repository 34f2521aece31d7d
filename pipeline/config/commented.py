"""A mission file with comments: what each key means, as the schema says it."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping
from typing import Any, get_args, get_type_hints

import yaml

from pipeline.config.base import Strict
from pipeline.config.mission import Mission
from pipeline.config.reference import keys_of

_KEY = re.compile(r"^(?P<indent> *)(?P<dash>- )?(?P<key>\w+):(?P<value>.*)$")
_WIDTH = 100
#: what a key means when it is absent, and markup, say nothing to somebody who reads the file
_NOT_HERE = re.compile(r"\s*Absent: .*?\.(?=\s+[A-Z]|\s*$)|`|\[([^\]]+)\]\([^)]*\)|\[([^\]]+)\]")


def commented_mission(document: Mapping[str, Any], head: str) -> str:
    """The YAML of a mission's document; each key has its meaning above it, once. head: the first comment."""
    meanings = _meanings(Mission)
    lines = [f"# {head}"]
    above: list[tuple[int, str]] = []
    said: set[str] = set()
    for line in yaml.safe_dump(dict(document), sort_keys=False).splitlines():
        found = _KEY.match(line)
        if found is None:
            lines.append(line)
            continue
        column = len(found["indent"]) + len(found["dash"] or "")
        above = [(c, k) for c, k in above if c < column]
        path = ".".join([k for _, k in above] + [found["key"]])
        if path in meanings and path not in said:
            said.add(path)
            lines += _comment(meanings[path], len(found["indent"]))
        lines.append(line)
        above.append((column, found["key"]))
    return "\n".join(lines) + "\n"


def _comment(meaning: str, column: int) -> list[str]:
    indent = f"{' ' * column}# "
    return textwrap.wrap(meaning, _WIDTH, initial_indent=indent, subsequent_indent=indent)


def _meanings(record: type[Strict], prefix: str = "") -> dict[str, str]:
    """What each key means, by its path, such as ``fusion.second_look.height``; the keys of lists as of records."""
    found: dict[str, str] = {}
    hints = get_type_hints(record, include_extras=True)
    for key in keys_of(record):
        found[f"{prefix}{key.name}"] = _NOT_HERE.sub(r"\1\2", key.meaning).strip()
        for inner in _records_in(hints[key.name]):
            found |= _meanings(inner, f"{prefix}{key.name}.")
    return found


def _records_in(hint: Any) -> list[type[Strict]]:
    if isinstance(hint, type) and issubclass(hint, Strict):
        return [hint]
    return [record for part in get_args(hint) for record in _records_in(part)]

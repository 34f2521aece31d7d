"""``docs/mission-file.md``, from the schema: every key, what it may be, its default, an example.

Run as ``python -m pipeline.config.reference docs/mission-file.md`` (``make docs``). A key's meaning is the string
below its field; ``Example: `..```, at its end, is how it may be written, in YAML.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

from pydantic.fields import FieldInfo

from pipeline.config.base import Strict
from pipeline.config.inventory import Inventory
from pipeline.config.layout import Layout
from pipeline.config.mission import Mission
from pipeline.config.pool import Pool
from pipeline.config.value_words import default_of, example_of, values_of

#: what other pages describe
_ELSEWHERE: dict[type[Strict], str] = {Layout: "detectors.md#a-layout-without-code"}
#: examples of whole records that are longer are left to the record's own section, characters
_LONGEST = 120
_EXAMPLE = re.compile(r"\s*Example: `(?P<yaml>[^`]+)`\.$")
_HEAD = """\
# The mission file

Written by `make docs` from the schema (`pipeline/config`); a test holds that it is up to date.

A mission is a YAML file, and so are the [inventory](#inventory) and the [pool](#pool) that it names.
`searchlight init FOLDER` writes all three; the demo's [mission.yaml](../configs/missions/demo/mission.yaml)
is a complete example. Unknown keys fail, with the line. Paths are relative to the file that names them.
Every quantity says its unit, `{meters: 0.5}`; a bare number fails. Each of the three files may say
`version: 1`, the version of its format; another one is refused by name.

"required" keys must be there; of the others the default is given, or "absent": what that means is said with the key.
"""


@dataclass(frozen=True)
class Key:
    """A key of a record. hint: its type, with all that narrows it. example: YAML."""

    name: str
    hint: Any
    field: FieldInfo
    meaning: str
    example: str


def keys_of(record: type[Strict]) -> list[Key]:
    """Every key of a record, in order. Raises LookupError for one whose meaning or example is not given."""
    hints, texts = get_type_hints(record, include_extras=True), _texts(record)
    keys = []
    for name, field in record.model_fields.items():
        if name not in texts:
            raise LookupError(
                f"{record.__module__}.{record.__name__}.{name}: write what it means below the field"
            )
        given = _EXAMPLE.search(texts[name])
        example = given["yaml"] if given else example_of(hints[name], field, _written_out)
        if example is None:
            raise LookupError(
                f"{record.__module__}.{record.__name__}.{name}: end its text with Example: `..`."
            )
        keys.append(Key(name, hints[name], field, _EXAMPLE.sub("", texts[name]).strip(), example))
    return keys


def _written_out(record: type[Strict]) -> str:
    """A record with the keys that it requires, or else with its first one."""
    keys = keys_of(record)
    required = [key for key in keys if key.field.is_required()] or keys[:1]
    return "{" + ", ".join(f"{key.name}: {key.example}" for key in required) + "}"


def _texts(record: type[Strict]) -> dict[str, str]:
    """The strings below the fields of a record and of those that it extends."""
    texts: dict[str, str] = {}
    for owner in reversed(record.__mro__):
        if not issubclass(owner, Strict) or owner is Strict:
            continue
        tree = ast.parse(textwrap.dedent(inspect.getsource(owner))).body[0]
        assert isinstance(tree, ast.ClassDef)
        for field, text in zip(tree.body, tree.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and _is_text(text):
                texts[field.target.id] = " ".join(ast.literal_eval(text.value).split())  # type: ignore[attr-defined]
    return texts


def _is_text(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def records_of(root: type[Strict]) -> list[type[Strict]]:
    """A record and those below it, each once, each after the one that names it first."""
    found: list[type[Strict]] = []

    def visit(record: type[Strict]) -> None:
        if record in found or record in _ELSEWHERE:
            return
        found.append(record)
        for hint in get_type_hints(record, include_extras=True).values():
            for inner in _records_in(hint):
                visit(inner)

    visit(root)
    return found


def _records_in(hint: Any) -> Iterator[type[Strict]]:
    if isinstance(hint, type) and issubclass(hint, Strict):
        yield hint
    for part in get_args(hint):
        yield from _records_in(part)


def mission_file_page() -> str:
    """The whole page, Markdown."""
    parts = [_HEAD]
    written: set[type[Strict]] = set()
    for root in (Mission, Inventory, Pool):
        for record in records_of(root):
            if record not in written:
                written.add(record)
                parts.append(_section(record))
    return "\n".join(parts)


def title_of(record: type[Strict]) -> str:
    """The heading of a record's section: two records may have one name."""
    own = {"pipeline.config.pool": {"Calibration": "Score calibration"}}
    return own.get(record.__module__, {}).get(record.__name__, _words(record.__name__))


def _words(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).capitalize()


def link_to(record: type[Strict]) -> str:
    """A link to where a record is described."""
    title = title_of(record)
    return f"[{title.lower()}]({_ELSEWHERE.get(record, '#' + title.lower().replace(' ', '-'))})"


def _section(record: type[Strict]) -> str:
    lines = [f"## {title_of(record)}", "", inspect.cleandoc(record.__doc__ or "").replace("``", "`"), ""]
    lines += ["| key | value | default | example | meaning |", "|---|---|---|---|---|"]
    for key in keys_of(record):
        cells = (
            f"`{key.name}`",
            values_of(key.hint, key.field, link_to),
            # a validator fills in what is required of the record, but not of the file
            "absent" if "Absent:" in key.meaning else default_of(key.hint, key.field),
            f"`{key.name}: {key.example}`" if len(key.example) <= _LONGEST else "see there",
            key.meaning,
        )
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(mission_file_page(), encoding="utf-8")

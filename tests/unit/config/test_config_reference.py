"""The mission file's reference is that of the schema, whole, and its examples hold."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, get_origin

import pytest
import yaml
from pydantic import Field, TypeAdapter

from pipeline.config.base import Strict
from pipeline.config.inventory import Inventory
from pipeline.config.mission import Mission
from pipeline.config.pool import Pool
from pipeline.config.reference import keys_of, mission_file_page, records_of
from pipeline.config.units import Meters, PositiveMeters, Radians
from pipeline.config.value_words import default_of, values_of

ROOT = Path(__file__).resolve().parents[3]
RECORDS = list(dict.fromkeys(r for root in (Mission, Inventory, Pool) for r in records_of(root)))
#: a shortest example that leaves out a choice that its section explains
NOT_WHOLE = {("Mission", "streams")}


def test_the_committed_page_is_what_the_schema_says() -> None:
    page = (ROOT / "docs/mission-file.md").read_text(encoding="utf-8")
    assert page == mission_file_page(), "run `make docs`"


@pytest.mark.parametrize("record", RECORDS, ids=lambda r: f"{r.__module__.rpartition('.')[2]}.{r.__name__}")
def test_every_example_is_accepted(record: type[Strict]) -> None:
    for key in keys_of(record):
        if (record.__name__, key.name) in NOT_WHOLE:
            continue
        narrowed = key.hint if get_origin(key.hint) is Annotated else Annotated[key.hint, key.field]
        TypeAdapter(narrowed).validate_python(yaml.safe_load(key.example))


class Drawer(Strict):
    """A record of this test."""

    depth: PositiveMeters | None = None
    """How deep. Example: `{centimeters: 40}`."""
    turn: Radians = 0.5
    """How far."""
    handles: int = Field(default=2, ge=1, le=4)
    """How
    many.
    """
    labels: tuple[Meters, ...] = ()
    """Where. Example: `[{meters: 1}]`."""


def test_units_ranges_defaults_and_examples_are_those_of_the_field() -> None:
    keys = {key.name: key for key in keys_of(Drawer)}
    values = {n: values_of(k.hint, k.field, lambda record: record.__name__) for n, k in keys.items()}
    assert values["depth"] == "`meters` or `centimeters` or `kilometers`; more than 0"
    assert values["turn"] == "`degrees` or `radians`"
    assert values["handles"] == "whole number; at least 1, at most 4"
    assert values["labels"] == "list of `meters` or `centimeters` or `kilometers`"
    assert [default_of(k.hint, k.field) for k in keys.values()] == [
        "absent",
        "`{degrees: 28.6479}`",
        "`2`",
        "absent",
    ]
    assert [k.example for k in keys.values()] == [
        "{centimeters: 40}",
        "{degrees: 28.6479}",
        "2",
        "[{meters: 1}]",
    ]
    assert [k.meaning for k in keys.values()] == ["How deep.", "How far.", "How many.", "Where."]


class Unexplained(Strict):
    """A record whose key says nothing."""

    width: Meters


class WithoutExample(Strict):
    """A record whose key has no example."""

    width: Meters
    """How wide."""


@pytest.mark.parametrize("record", [Unexplained, WithoutExample])
def test_a_key_without_meaning_or_example_is_named(record: Any) -> None:
    with pytest.raises(LookupError, match=f"{record.__name__}.width"):
        keys_of(record)

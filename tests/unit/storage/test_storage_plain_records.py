"""Records as JSON: what is read is what was written."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.storage.plain_records import from_plain, to_plain


@dataclass(frozen=True)
class Leaf:
    name: str
    number: float


@dataclass(frozen=True)
class Node:
    leaves: tuple[Leaf, ...]
    named: frozenset[Leaf]
    links: dict[tuple[str, str], float]
    child: Node | None = None


CLASSES = {"Leaf": Leaf, "Node": Node}
leaves = st.builds(Leaf, st.text(), st.floats(allow_nan=False))
nodes = st.recursive(
    st.builds(
        Node,
        st.lists(leaves, max_size=3).map(tuple),
        st.frozensets(leaves, max_size=3),
        st.dictionaries(st.tuples(st.text(), st.text()), st.floats(allow_nan=False), max_size=3),
    ),
    lambda inner: st.builds(Node, st.just(()), st.just(frozenset()), st.just({}), inner),
    max_leaves=3,
)


@given(nodes)
def test_what_is_read_is_what_was_written(value: Node) -> None:
    assert from_plain(json.loads(json.dumps(to_plain(value))), CLASSES) == value


@given(st.lists(leaves, unique=True))
def test_equal_sets_are_written_alike_whatever_their_order(members: list[Leaf]) -> None:
    assert to_plain(frozenset(members)) == to_plain(frozenset(reversed(members)))


def test_infinity_is_a_number() -> None:
    assert from_plain(json.loads(json.dumps(to_plain(Leaf("rate", math.inf)))), CLASSES).number == math.inf


@pytest.mark.parametrize(
    ("plain", "named"),
    [
        ({"@": "Popen", "args": ["rm"]}, "Popen"),
        ({"@": "Leaf", "name": "x"}, "Leaf"),
        ({"@": "Leaf", "name": "x", "number": 1.0, "more": 2}, "Leaf"),
        ({"name": "x"}, "None"),
    ],
)
def test_another_class_or_other_fields_are_refused_by_name(plain: object, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        from_plain(plain, CLASSES)


def test_what_json_cannot_say_is_refused() -> None:
    with pytest.raises(TypeError, match="object"):
        to_plain((object(),))

"""Finding the columns of a known format by the names that it gives them."""

from __future__ import annotations

import re
from collections.abc import Mapping

from pipeline.config.telemetry import Column
from pipeline.ingest.tables.delimited import DelimitedTable
from pipeline.ingest.tables.units import split_unit
from pipeline.ingest.text import decoded


def columns_by_names(table: DelimitedTable, names: Mapping[str, tuple[str, ...]]) -> dict[str, Column]:
    """The column of each quantity: the first of its names that the table has, whatever unit stands behind it.

    A name with its unit in brackets means that one alone.
    """
    found: dict[str, Column] = {}
    for quantity, candidates in names.items():
        index = next((i for name in candidates if (i := _index(table, name)) is not None), None)
        if index is not None:
            found[quantity] = Column.model_construct(name=table.names[index], unit=None, zone=None)
    return found


def _index(table: DelimitedTable, name: str) -> int | None:
    exact = table.index(name)
    if exact is not None:
        return exact
    wanted = plain_name(name)
    return next(
        (i for i, known in enumerate(table.names) if plain_name(split_unit(known)[0]) == wanted), None
    )


def plain_name(name: str) -> str:
    """A name without what differs between versions: letter case, spaces, underscores."""
    return re.sub(r"[\s_]+", "", name).lower()


def head_names(head: bytes) -> frozenset[str]:
    """Every word of the first lines of a file that could be a column's name, without its unit."""
    lines = decoded(head).split("\n")[:5]
    cells = (cell for line in lines for cell in re.split(r"[,;\t|]", line))
    return frozenset(plain_name(split_unit(cell.strip().strip('"'))[0]) for cell in cells)

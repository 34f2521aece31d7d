"""Delimited text to rows of cells, however the table is laid out."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.config.telemetry import Table as Layout
from pipeline.errors import InputError
from pipeline.ingest.samples import LeftOut
from pipeline.ingest.tables.units import is_unit

_DELIMITERS = ("\t", ";", "|", ",")
#: so many lines are looked at to find out how a table is laid out
_LOOKED_AT = 60
#: a quoted cell may hold so many line ends; more is a quote that was never closed, which must not eat the file
_LINES_PER_ROW = 5
_NUMBER = re.compile(r"[+\-−]?\d+(?:[.,]\d+)*(?:[eE][+-]?\d+)?\s*(?:[a-zA-Z°]{0,3})")
_DATE = re.compile(r"\d{1,4}[-/.:]\d{1,2}[-/.:]\d{1,4}.*|\d{1,2}:\d{2}.*")
_WORDS = ("true", "false")
_DECIMAL_COMMA = re.compile(r"[+\-−]?\d+,\d+")
_DECIMAL_POINT = re.compile(r"[+\-−]?\d+\.\d+")


@dataclass(frozen=True, slots=True)
class Row:
    """line: its first line in the file, from 1."""

    line: int
    cells: list[str]


@dataclass(frozen=True)
class DelimitedTable:
    """names: of the columns, one where the head has one, with the unit of a line of units in brackets.

    rows: of as many cells as there are columns, or fewer if a row is cut. left_out: other rows, by reason.
    """

    path: Path
    names: tuple[str, ...]
    rows: list[Row]
    decimal: str
    left_out: LeftOut = field(default_factory=LeftOut)

    def where(self, row: Row) -> str:
        """File and line."""
        return f"{self.path}:{row.line}"

    def index(self, name: str | int) -> int | None:
        """The column of a name (letter case and spaces do not matter) or number from 1; None: there is none."""
        if isinstance(name, int):
            return name - 1 if 1 <= name <= len(self.names) else None
        wanted = _folded(name)
        return next((i for i, known in enumerate(self.names) if _folded(known) == wanted), None)

    def column(self, index: int) -> list[str]:
        """The cells of a column, stripped; empty where a row is cut."""
        return [row.cells[index].strip() if index < len(row.cells) else "" for row in self.rows]


def read_table(path: Path, text: str, layout: Layout, free_text: str = "") -> DelimitedTable:
    """The table in a text. free_text: the last column's name, where it may hold delimiters that are none.

    Raises InputError if there is no table in it.
    """
    lines = text.split("\n")
    start, stated = _separator_line(lines)
    delimiter = layout.delimiter or stated or _delimiter(lines[start:])
    rows = list(_rows(lines, start, delimiter))
    head = _head_length(rows) if layout.head_lines is None else _rows_before(rows, layout.head_lines + 1)
    body = rows[head:]
    if not body:
        raise InputError(path, "no row of samples", "a table: a line of names, then a line for each sample")
    width = Counter(len(row.cells) for row in body[:1000]).most_common(1)[0][0]
    names = _names([row.cells for row in rows[:head]], width)
    kept, left_out = _fitting(path, body, names, delimiter, free_text)
    return DelimitedTable(path, names, kept, layout.decimal or _decimal(kept), left_out)


def _separator_line(lines: list[str]) -> tuple[int, str | None]:
    """``sep=;``, as spreadsheets write it: how many lines it takes, and the delimiter."""
    first = lines[0].strip().strip('"') if lines else ""
    if first.lower().startswith("sep=") and len(first) <= 5:
        return 1, first[4:] or ","
    return 0, None


def _delimiter(lines: list[str]) -> str:
    """The first that splits most lines into the same number of cells; a comma may be a decimal one: late.

    A space stands for any number of them.
    """
    looked_at = [line for line in lines[:_LOOKED_AT] if line.strip()]
    for delimiter in _DELIMITERS:
        counts = Counter(len(_cells(line, delimiter)) for line in looked_at)
        width, times = counts.most_common(1)[0] if counts else (1, 0)
        if width >= 3 and times >= 0.5 * len(looked_at):
            return delimiter
    return " " if len(looked_at[-1:]) and len(looked_at[-1].split()) >= 3 else ","


def _rows(lines: list[str], start: int, delimiter: str) -> Iterator[Row]:
    number = start
    while number < len(lines):
        taken = _lines_of_row(lines, number)
        line = "\n".join(lines[number : number + taken])
        if line.strip() and not line.lstrip().startswith(("#", "%")):
            yield Row(number + 1, _cells(line, delimiter))
        number += taken


def _lines_of_row(lines: list[str], number: int) -> int:
    quotes = 0
    for taken in range(1, _LINES_PER_ROW + 1):
        if number + taken > len(lines):
            break
        quotes += lines[number + taken - 1].count('"')
        if quotes % 2 == 0:
            return taken
    return 1


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    try:
        return next(csv.reader([line.replace("\n", " ")], delimiter=delimiter), [])
    except csv.Error:
        return line.split(delimiter)


def _head_length(rows: list[Row]) -> int:
    """How many rows stand before the first that holds values."""
    return next((i for i, row in enumerate(rows[:_LOOKED_AT]) if _has_values(row.cells)), len(rows))


def _has_values(cells: list[str]) -> bool:
    filled = [cell.strip() for cell in cells if cell.strip()]
    values = sum(_is_value(cell) for cell in filled)
    return values >= 2 and values >= 0.3 * len(filled)


def _is_value(cell: str) -> bool:
    return bool(_NUMBER.fullmatch(cell) or _DATE.fullmatch(cell)) or cell.lower() in _WORDS


def _rows_before(rows: list[Row], line: int) -> int:
    return sum(row.line < line for row in rows)


def _names(head: list[list[str]], width: int) -> tuple[str, ...]:
    """The names of the columns: the last line of the head that has most of them, with a line of units below."""
    lines = [
        [cell.strip() for cell in cells] for cells in head if len(cells) >= 0.5 * width and len(cells) > 1
    ]
    if not lines:
        return tuple(f"column {i + 1}" for i in range(width))
    units: list[str] = []
    if len(lines) > 1 and _is_line_of_units(lines[-1]):
        units = lines.pop()
    names = lines[-1]
    return tuple(_name(i, names, units) for i in range(len(names)))


def _is_line_of_units(cells: list[str]) -> bool:
    filled = [cell for cell in cells if cell]
    return bool(filled) and sum(is_unit(cell) for cell in filled) >= 0.5 * len(filled)


def _name(i: int, names: list[str], units: list[str]) -> str:
    name = names[i] or f"column {i + 1}"
    unit = units[i].strip("()[]{} ") if i < len(units) else ""
    return f"{name} ({unit})" if unit else name


def _fitting(
    path: Path, rows: list[Row], names: tuple[str, ...], delimiter: str, free_text: str
) -> tuple[list[Row], LeftOut]:
    """Rows without surplus cells, or only with those of a free text at the end, after a cell that is no number.

    Raises InputError if most rows have surplus cells: then the cells are not what they seem.
    """
    kept, left_out = [], LeftOut()
    for row in rows:
        surplus = any(cell.strip() for cell in row.cells[len(names) :])
        in_text = (
            surplus and _folded(names[-1]) == free_text and not _is_value(row.cells[len(names) - 2].strip())
        )
        if surplus and not in_text:
            left_out.add("surplus_cells", f"{path}:{row.line}")
        else:
            kept.append(row)
    if len(kept) < 0.5 * len(rows):
        found = f"rows of more cells than the {len(names)} of the head, split at {delimiter!r}"
        raise InputError(path, found, "telemetry.table with delimiter, decimal or head_lines")
    return kept, left_out


def _decimal(rows: list[Row]) -> str:
    """A comma, if more numbers have one than have a point."""
    cells = [cell.strip() for row in rows[:200] for cell in row.cells]
    commas = sum(_DECIMAL_COMMA.fullmatch(cell) is not None for cell in cells)
    return "," if commas > sum(_DECIMAL_POINT.fullmatch(cell) is not None for cell in cells) else "."


def _folded(name: str) -> str:
    return re.sub(r"\s+", "", name).casefold()

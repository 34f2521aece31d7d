"""Faults of independent parts of a mission, collected, so that a user sees all of them at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from pipeline.errors import InputError, SeveralInputsError


class Faults:
    """What was wrong so far. A step that needs a faulty part is not taken."""

    def __init__(self) -> None:
        self._found: list[InputError] = []

    @contextmanager
    def collected(self) -> Iterator[None]:
        """An InputError within it is kept, and ends only the block."""
        try:
            yield
        except SeveralInputsError as several:
            self._found += several.faults
        except InputError as error:
            self._found.append(error)

    def raise_if_any(self) -> None:
        """Raises the only fault, or SeveralInputsError for several."""
        unique = list({str(fault): fault for fault in self._found}.values())
        if len(unique) == 1:
            raise unique[0]
        if unique:
            raise SeveralInputsError(tuple(unique))

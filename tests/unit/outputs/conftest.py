"""The synthetic search as a fixture."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from synthetic_search import search_of

from pipeline.outputs.report import ReportData


@pytest.fixture
def search() -> Callable[..., ReportData]:
    """search(found=True, known=True, size=SIZE) makes the search."""
    return search_of

"""Work that must be done where a stream's files are: on its drone, which may be another machine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

T = TypeVar("T")


class Near(Protocol):
    """Does work at a site and gives its result. What it raises is raised here. The work is a function of a module."""

    def __call__(self, site: str, work: Callable[..., T], *arguments: object) -> T: ...


def here(site: str, work: Callable[..., T], *arguments: object) -> T:
    """All files are on this machine."""
    return work(*arguments)

"""What a piece of the program is at present: results that are kept are worth nothing once their code changed."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path


@lru_cache(maxsize=32)
def code_sha256(*modules: str) -> str:
    """The sha256 of the source of modules and of packages with all that is in them, by name.

    Raises ModuleNotFoundError for a name that is none.
    """
    digest = hashlib.sha256()
    for module in sorted(modules):
        for path in _files(module):
            digest.update(path.name.encode("utf-8") + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _files(module: str) -> Iterator[Path]:
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(module)
    folders = spec.submodule_search_locations
    if folders:
        for folder in folders:
            yield from sorted(Path(folder).rglob("*.py"))
    else:
        yield Path(spec.origin)

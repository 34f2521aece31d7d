"""What the files of a mission hold, to know them again: a run goes on with the same input only."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from pipeline.mission.prepared import PreparedMission

#: files up to this are read whole; of larger ones, which are videos, their size and blocks evenly spread over them
_WHOLE_BYTES = 64 * 1024 * 1024
_BLOCK_BYTES, _BLOCKS = 64 * 1024, 256


def input_digests(prepared: PreparedMission) -> dict[str, str]:
    """Of every file that a mission names, by its path."""
    paths = {prepared.path}
    for record in (prepared.mission, prepared.inventory, prepared.pool):
        paths |= set(_paths(record))
    if prepared.onto is not None:
        paths.add(prepared.onto.path)
    for stream in prepared.streams:
        paths |= set(stream.source.paths)
    return {str(path): digest_of(path) for path in sorted(_files(paths))}


def digest_of(path: Path) -> str:
    """Of a file's content: the whole of it, or so much that another recording cannot have it."""
    size = path.stat().st_size
    digest = hashlib.sha256(size.to_bytes(8, "little"))
    with path.open("rb") as file:
        if size <= _WHOLE_BYTES:
            while block := file.read(1 << 20):
                digest.update(block)
            return digest.hexdigest()
        for number in range(_BLOCKS):
            file.seek((size - _BLOCK_BYTES) * number // (_BLOCKS - 1))
            digest.update(file.read(_BLOCK_BYTES))
    return digest.hexdigest()


def _files(paths: set[Path]) -> set[Path]:
    """The files among paths, and those in the folders among them."""
    files = {path.absolute() for path in paths if path.is_file()}
    for folder in paths:
        if folder.is_dir():
            files |= {path.absolute() for path in folder.iterdir() if path.is_file()}
    return files


def _paths(value: Any) -> Iterator[Path]:
    if isinstance(value, Path):
        yield value
    elif isinstance(value, BaseModel):
        for name in type(value).model_fields:
            yield from _paths(getattr(value, name))
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from _paths(item)
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _paths(item)

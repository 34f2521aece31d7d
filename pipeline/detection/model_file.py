"""The file of a model."""

from __future__ import annotations

import hashlib
from pathlib import Path

from pipeline.errors import InputError


def require_hash(path: Path, sha256: str | None) -> None:
    """Raises InputError unless the file is the one that the pool was measured with; a missing one passes."""
    if sha256 is None or not path.is_file():
        return
    found = sha256_of(path)
    if found != sha256:
        expected = f"{sha256[:12]}.., the file that the pool was measured with, or a pool of this one"
        raise InputError(path, f"a file of sha256 {found[:12]}..", expected)


def sha256_of(path: Path) -> str:
    """Of the file's bytes, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

"""Files that a node needs and may not have: known by their content, fetched once, kept."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import InputError
from pipeline.storage.whole_or_nothing import make_folder, write_bytes


def sha256_of(path: Path) -> str:
    """Of a file's content."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


@dataclass(frozen=True)
class KeptModels:
    """folder: of this node. fetch(sha256): the content, from whoever asks for the work."""

    folder: Path
    fetch: Callable[[str], bytes]

    def path(self, model: Path, sha256: str) -> Path:
        """Where a model of this content lies: at its own path, or else in the folder, fetched if it is not there yet.

        Raises InputError for what was fetched and is something else.
        """
        if model.is_file() and sha256_of(model) == sha256:
            return model
        kept = self.folder / f"{sha256}{model.suffix}"
        if kept.is_file() and sha256_of(kept) == sha256:
            return kept
        data = self.fetch(sha256)
        found = hashlib.sha256(data).hexdigest()
        if found != sha256:
            raise InputError(model, f"content of sha256 {found[:12]}", f"that of sha256 {sha256[:12]}")
        make_folder(self.folder)
        write_bytes(kept, data)
        return kept

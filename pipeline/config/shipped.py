"""The files that come with Searchlight: the demo, pools, inventories, detectors."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path


def shipped(*names: str) -> Path:
    """A file or folder under ``configs``: of the checkout that this code stands in, or of the installed wheel."""
    beside = Path(__file__).resolve().parents[2] / "configs"
    root = beside if (beside / "missions").is_dir() else Path(str(files("searchlight_configs")))
    return root.joinpath(*names)

"""The files that come with Searchlight: the demo, pools, inventories, detectors."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from pipeline.errors import InputError


def shipped(*names: str) -> Path:
    """A file or folder under ``configs``: of the checkout that this code stands in, or of the installed wheel."""
    beside = Path(__file__).resolve().parents[2] / "configs"
    return (beside if (beside / "missions").is_dir() else _installed()).joinpath(*names)


def _installed() -> Path:
    # not importlib.resources: of a package without a module it gives something that is no path
    spec = find_spec("searchlight_configs")
    if spec is None or not spec.submodule_search_locations:
        raise InputError("searchlight_configs", "nothing", "an installed wheel, or a checkout with configs/")
    return Path(next(iter(spec.submodule_search_locations)))

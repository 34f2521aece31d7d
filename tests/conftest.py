"""A mission for the tests that need files: rendered once per session, with inventory and pool beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.missions import render_small


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Which tests stay together when two processes share them (``make test``): those of a file, since they share
    fixtures; and all of tests/integration, since two Rays at once would measure each other.
    """
    from xdist.scheduler import LoadScopeScheduling

    class ByFile(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.split("::", maxsplit=1)[0]
            return "integration" if file.startswith("tests/integration/") else file

    return ByFile(config, log)


@pytest.fixture(scope="session")
def small_mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As ``render_small`` says."""
    return render_small(tmp_path_factory.mktemp("small") / "mission")

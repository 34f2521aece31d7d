"""A mission for the tests that need files: rendered once per session, with inventory and pool beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]


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
    """mission.yaml of a few seconds of two drones; the folder can be copied as it is."""
    from pipeline.simulation.mission_writer import simulate

    folder = tmp_path_factory.mktemp("small") / "mission"
    mission = simulate(ROOT / "tests/data/small.yaml", folder, progress=lambda *_: None)
    inventory = (ROOT / "configs/inventories/demo.yaml").read_text(encoding="utf-8")
    (folder / "inventory.yaml").write_text(inventory, encoding="utf-8")
    pool = (ROOT / "configs/pools/demo.yaml").read_text(encoding="utf-8")
    (folder / "pool.yaml").write_text(
        pool.replace("../detectors", str(ROOT / "configs/detectors")), encoding="utf-8"
    )
    lines = mission.read_text(encoding="utf-8").splitlines()
    here = {"inventory": "inventory: inventory.yaml", "pool": "pool: pool.yaml"}
    lines = [here.get(line.split(":")[0], line) for line in lines]
    mission.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return mission

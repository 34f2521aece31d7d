"""The mission that tests render for themselves."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def render_small(folder: Path) -> Path:
    """mission.yaml of a few seconds of two drones, with inventory and pool beside it; the folder can be copied."""
    from pipeline.simulation.mission_writer import simulate

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

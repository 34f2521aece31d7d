"""The paper's machines and detectors as shipped."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.experiments.paper_instance import PaperInstance, load_paper_instance

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.fixture(scope="session")
def instance() -> PaperInstance:
    return load_paper_instance(
        CONFIGS / "pools" / "paper-allocation.yaml", CONFIGS / "inventories" / "paper-allocation.yaml"
    )

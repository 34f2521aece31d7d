"""A mission with a prior says what the search was worth, and where the missing person may still be."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import rasterio
import yaml
from typer.testing import CliRunner

from actors.cli import app


@pytest.mark.slow
def test_a_mission_with_a_last_known_point_from_files_to_what_remains(
    small_mission: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "mission"
    shutil.copytree(small_mission.parent, folder)
    document = yaml.safe_load((folder / "mission.yaml").read_text())
    point = {"latitude": {"degrees": 58.4021}, "longitude": {"degrees": 15.5752}}
    rings = [{"within": {"meters": 8}, "probability": 0.5}, {"within": {"meters": 40}, "probability": 0.9}]
    document["prior"] = {"last_known_point": point, "rings": rings}
    (folder / "mission.yaml").write_text(yaml.safe_dump(document))
    out = tmp_path / "run"
    result = CliRunner().invoke(app, ["run", str(folder / "mission.yaml"), "--out", str(out), "--local"])
    assert result.exit_code == 0, result.output
    summary = json.loads((out / "summary.json").read_text())
    prior = summary["coverage"]["prior"]
    assert 0.7 < prior["on_map"] <= 0.9
    assert 0.0 < prior["probability_of_success"] < prior["on_map"]
    said = f"would have been found with {prior['probability_of_success']:.0%} (probability of success)"
    assert said in summary["verdict"]["sentence"]
    assert said in (out / "report.html").read_text()
    with rasterio.open(out / "remaining.tif") as source:
        left, elsewhere = source.read(1), float(source.tags()["ELSEWHERE"])
    assert left.sum() + elsewhere == pytest.approx(1.0, abs=1e-4)
    assert left.max() > 0.0
    document["prior"]["rings"][0]["probability"] = 2.0
    (folder / "mission.yaml").write_text(yaml.safe_dump(document))
    refused = CliRunner().invoke(app, ["check", str(folder / "mission.yaml")])
    assert "prior.rings.0.probability" in str(refused.exception)

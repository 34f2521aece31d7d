"""The optics of a zoom are made once, few are kept, and they go from one process to another."""

import pickle
from pathlib import Path

from pipeline.config.mission import load_mission
from pipeline.fusion.optics import OpticsByFocalLength
from pipeline.geo.camera import Camera

DEMO = Path(__file__).parents[3] / "configs/missions/demo/mission.yaml"


def test_optics_travel_and_are_kept() -> None:
    camera = Camera(width=64, height=48, fx=50.0, fy=50.0, cx=32.0, cy=24.0)
    optics = OpticsByFocalLength(camera, load_mission(DEMO).fusion)
    assert optics.at(2.0) is optics.at(2.0)
    for k in range(200):
        optics.at(1.0 + k / 1000.0)
    again = pickle.loads(pickle.dumps(optics))
    assert again.at(2.0).camera.fx == optics.at(2.0).camera.fx == 100.0

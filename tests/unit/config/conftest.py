"""A mission, an inventory, a pool and a camera that are right, as text; tests break them in one way each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

INVENTORY = """\
sites:
  - id: van
    machines:
      - {id: laptop, type: cpu-8, memory: {gigabytes: 16}, count: 2}
      - id: jetson
        type: gpu-s
        memory: {gigabytes: 8}
        provider: cuda
links:
  - {stream: drone-1, site: van, bandwidth: {mbps: 4}}
  - {stream: drone-2, site: van, bandwidth: {mbps: .inf}}
"""

POOL = """\
detectors:
  - id: nano
    model: nano.onnx
    memory: {megabytes: 300}
    accuracy:
      - {bitrate: {mbps: 1}, accuracy: 0.6}
      - {bitrate: {mbps: 4}, accuracy: 0.7}
    times:
      - {machine: cpu-8, mean: {milliseconds: 20}, maximum: {milliseconds: 30}}
"""

CAMERA = """\
width: 1024
height: 576
fx: 900.0
fy: 900.0
cx: 512.0
cy: 288.0
"""

MISSION = """\
name: Bear valley
terrain: {file: dsm.tif}
streams:
  - id: drone-1
    video: drone-1.mp4
    telemetry:
      file: drone-1.srt
      time_offset: {milliseconds: 40}
    camera: camera.yaml
    site: drone-1
inventory: inventory.yaml
pool: pool.yaml
processing:
  frame_rate: {hertz: 10}
  max_processing_time: {seconds: 1}
  bitrates: [{mbps: 1}, {mbps: 4}]
fusion:
  cell_size: {meters: 0.5}
  positive_max: 0.4
  negative_max: 0.2
  tukey_alpha: 0.5
  significant_point: bottom_center
  object_size:
    width_min: {meters: 0.3}
    width_max: {meters: 2}
    height_min: {meters: 0.3}
    height_max: {meters: 2}
  threshold: 0.9
  cluster_distance: {meters: 1.5}
  lateness: {seconds: 5}
truth: people.geojson
"""

TEXTS = {"inventory": INVENTORY, "pool": POOL, "camera": CAMERA, "mission": MISSION}


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """write(kind, old, new) writes the right text with ``old`` (found exactly once) replaced by ``new``."""

    def write(kind: str, old: str = "", new: str = "") -> Path:
        text = TEXTS[kind]
        assert not old or text.count(old) == 1, f"{old!r} is {text.count(old)} times in the text"
        path = tmp_path / f"{kind}.yaml"
        path.write_text(text.replace(old, new) if old else text, encoding="utf-8")
        return path

    return write

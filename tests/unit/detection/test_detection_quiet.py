import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]


def test_loading_a_detector_writes_nothing_into_the_home_folder(tmp_path: Path) -> None:
    code = (
        "from pathlib import Path\n"
        "from pipeline.detection import load_detector\n"
        f"load_detector(Path({str(ROOT / 'configs/detectors/nano.onnx')!r}), score_threshold=0.3)\n"
    )
    cache = {"NUMBA_CACHE_DIR": str(tmp_path / "numba")}
    home = tmp_path / "home"
    home.mkdir()
    env = {k: v for k, v in os.environ.items() if k != "ORT_DISABLE_TELEMETRY"} | {"HOME": str(home)} | cache
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=env, check=True)
    assert list(home.rglob("*")) == []

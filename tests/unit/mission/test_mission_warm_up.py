"""After the warm-up a reducer compiles nothing more: in a fresh installation its first results took seconds each."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PROGRAM = """
import sys
from dataclasses import replace
from pathlib import Path
import numpy as np
from numba.core.registry import CPUDispatcher
from pipeline.messages import Detections, pack, unpack
from pipeline.mission.live_files import LiveMap, begin_live
from pipeline.mission.local import make_reducer
from pipeline.mission.planning import plan
from pipeline.mission.prepared import prepare
from pipeline.mission.warm_up import warm_up

def compiled():
    modules = [module for name, module in list(sys.modules.items()) if name.startswith("pipeline.")]
    functions = {id(f): f for module in modules for f in vars(module).values() if isinstance(f, CPUDispatcher)}
    return {(f.py_func.__qualname__, str(types)) for f in functions.values() for types in f.signatures}

prepared = prepare(Path(sys.argv[1]))
planned = plan(prepared)
warm_up(prepared, planned)
before = compiled()
stage, rng = make_reducer(prepared, planned, lateness=False), np.random.default_rng(1)
live = LiveMap(begin_live(Path(sys.argv[2]), prepared), prepared)
for sequence in range(30):
    for a in planned.assignments:
        stream = next(s for s in prepared.streams if s.stream == a.stream)
        time_s = stream.video.start_s + 0.1 * sequence
        n = sequence % 3
        corner = rng.uniform((100, 100), (300, 200), (n, 2))
        boxes = np.hstack([corner, corner + rng.uniform(10, 60, (n, 2))])
        scores, classes = rng.uniform(0.1, 0.9, n), np.zeros(n, dtype=np.int64)
        time_ns, pose = stream.start_ns + int(time_s * 1e9), stream.trajectory.pose(time_s)
        result = Detections(a.stream, a.detector, sequence, time_ns, pose, boxes, scores, classes)
        stage.push(unpack(pack(replace(result, sequence=sequence))))
live.write(stage)
stage.finish()
taken = sum(map(len, stage.processed.values()))
assert taken == 30 * len(planned.assignments), (taken, stage.not_taken)
assert sum(stage.detections.values()) > 0, stage.not_taken
assert len(before) > 10
print(sorted(compiled() - before))
"""


def test_results_as_they_come_from_the_wire_find_everything_compiled(
    small_mission: Path, tmp_path: Path
) -> None:
    found = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(small_mission), str(tmp_path)],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert (found.returncode, found.stdout.strip()) == (0, "[]"), found.stderr

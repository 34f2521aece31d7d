"""Seeded runs of a short mission in real time on Ray, whose actors are killed, stopped and cut off: which laws held.

    python -m tests.benchmarks.bench_chaos --out FILE.json [--runs 100] [--first 0]

Resumable: a seed that FILE holds already is not run again. The laws are in ``tests/chaos_on_ray.py``.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pipeline.errors import in_one_line
from pipeline.storage.whole_or_nothing import write_text
from tests.chaos_on_ray import chaotic_run
from tests.missions import render_small


def main() -> None:
    """Run what is missing, and say what held."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    known: dict[str, Any] = json.loads(asked.out.read_text()) if asked.out.exists() else {}
    with tempfile.TemporaryDirectory() as folder:
        mission = render_small(Path(folder) / "mission")
        for seed in range(asked.first, asked.first + asked.runs):
            if str(seed) not in known:
                known[str(seed)] = _result(mission, Path(folder) / "run", seed)
                write_text(asked.out, json.dumps(known, indent=1) + "\n")
                print(seed, known[str(seed)].get("broken", "all laws hold"), flush=True)
    broken = [seed for seed, result in known.items() if "broken" in result]
    late = sum(result.get("late", 0) for result in known.values())
    print(f"{len(known)} runs; a law was broken in {len(broken)}: {broken}; results that came late: {late}")


def _result(mission: Path, out: Path, seed: int) -> dict[str, Any]:
    shutil.rmtree(out, ignore_errors=True)
    date = datetime.now(UTC).isoformat(timespec="seconds")
    try:
        return {"date": date, **chaotic_run(mission, out, seed)}
    except Exception as error:  # what broke is the result
        return {"date": date, "broken": f"{type(error).__name__}: {in_one_line(error)}"[:4000]}


if __name__ == "__main__":
    main()

"""Models are opened and run in a child process first: a spoiled one can end the process that opens it.

Each file once per hash; what was found is kept in the system's folder for temporary files.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

from pipeline.detection.model_file import sha256_of
from pipeline.errors import InputError, SearchlightError

#: opening a model and one picture take no longer on any machine that should look at video
_TIMEOUT_S = 60.0
_FINE = "fine"


def require_survivable(path: Path) -> None:
    """Raises InputError for a model that ends the process, never ends itself, or fails in an unforeseen way."""
    reason = survived([path])[path]
    if reason is not None:
        raise InputError(path, reason, "a model that ONNX Runtime can run")


def survived(paths: Sequence[Path]) -> dict[Path, str | None]:
    """Of each file why it must not be opened here, or None. Missing files pass: that is said elsewhere."""
    kept = {path: _read(path) for path in paths if path.is_file()}
    left = [path for path, known in kept.items() if known is None]
    while left:
        done, reason = _child(left)
        for path in left[:done]:
            kept[path] = _kept(path, _FINE)
        if done < len(left):
            kept[left[done]] = _kept(left[done], reason)
        left = left[done + 1 :]
    return {path: None if kept.get(path) in (None, _FINE) else kept[path] for path in paths}


def _child(paths: list[Path]) -> tuple[int, str]:
    """Go through files in a child: how many it survived, and what the next one did."""
    command = [sys.executable, "-m", "pipeline.detection.crash_test", *map(str, paths)]
    root = Path(__file__).parents[2]
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])}
    with tempfile.TemporaryFile() as told:
        try:
            limit_s = _TIMEOUT_S + 2.0 * len(paths)
            code = subprocess.run(
                command, stdout=told, stderr=subprocess.DEVNULL, timeout=limit_s, check=False, env=env
            ).returncode
        except subprocess.TimeoutExpired:
            code = None
        told.seek(0)
        lines = told.read().decode().splitlines()
    done = sum(line == _FINE for line in lines)
    if code is None:
        return done, f"a model that takes longer than {limit_s:.0f} s to open and run once"
    if code < 0:
        return done, f"a model that ends the process that opens it ({signal.Signals(-code).name})"
    unforeseen = lines[-1] if lines and lines[-1] != _FINE else f"exit code {code}"
    return done, f"a model that cannot be read ({unforeseen[:160]})"


def _file(path: Path) -> Path:
    folder = Path(tempfile.gettempdir()) / f"searchlight-models-{os.getuid()}"
    return folder / f"{sha256_of(path)}-{version('onnxruntime')}.json"


@lru_cache(maxsize=1024)
def _known(file: Path, owner: int) -> str | None:
    try:
        if file.parent.stat().st_uid != owner:  # anybody may write into that folder's parent
            return None
        found = json.loads(file.read_text(encoding="utf-8"))
        return found if isinstance(found, str) else None
    except (OSError, ValueError):
        return None


def _read(path: Path) -> str | None:
    found = _known(_file(path), os.getuid())
    if found is None:
        _known.cache_clear()
    return found


def _kept(path: Path, reason: str) -> str:
    file = _file(path)
    try:
        file.parent.mkdir(mode=0o700, exist_ok=True)
        temporary = file.with_suffix(f".{os.getpid()}")
        temporary.write_text(json.dumps(reason), encoding="utf-8")
        temporary.replace(file)
    except OSError:
        pass  # it is looked at again the next time
    return reason


def _go_through(paths: list[Path]) -> None:
    from pipeline.detection.recognition import recognise
    from pipeline.detection.session import Session

    for path in paths:
        try:
            recognise(Session(path, 1, "cpu"), path)
        except SearchlightError:
            pass  # said by the process that asks
        except Exception as error:
            print(f"{type(error).__name__}: {' '.join(str(error).split())}", flush=True)
            sys.exit(1)
        print(_FINE, flush=True)


if __name__ == "__main__":
    _go_through([Path(argument) for argument in sys.argv[1:]])

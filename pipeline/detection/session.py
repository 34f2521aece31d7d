"""ONNX Runtime sessions: the one place that opens a model."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Unless told before its import, the library writes a device id into the home folder and reports usage.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"
import onnxruntime

from pipeline.errors import InputError

_PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}
_QUIET = 4


@dataclass(frozen=True, slots=True)
class Signature:
    """What a model takes and gives: shapes by tensor name, a free axis as its name; and its metadata."""

    inputs: dict[str, tuple[int | str | None, ...]]
    outputs: dict[str, tuple[int | str | None, ...]]
    metadata: dict[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        parts = [f"{name}{list(shape)}" for name, shape in (self.inputs | self.outputs).items()]
        return ", ".join(parts)


class Session:
    """An open model. One operator at a time, on so many threads, with the same result each time."""

    def __init__(self, path: Path, threads: int, provider: str) -> None:
        """Raises InputError for a missing file, one that is not ONNX, or a provider that is not installed."""
        if not path.is_file():
            raise InputError(path, "no file", "a detector as an ONNX file")
        name = _provider(path, provider)
        try:
            self._session = onnxruntime.InferenceSession(path, _options(threads), providers=[name])
        except Exception as error:  # ONNX Runtime's errors have no common root
            reason = str(error).splitlines()[0][:200]
            raise InputError(
                path, f"a file that is not a usable ONNX model ({reason})", "an ONNX model"
            ) from None
        meta = self._session.get_modelmeta().custom_metadata_map
        self.signature = Signature(
            {t.name: tuple(t.shape) for t in self._session.get_inputs()},
            {t.name: tuple(t.shape) for t in self._session.get_outputs()},
            dict(meta),
        )

    def run(self, inputs: dict[str, NDArray[Any]]) -> list[NDArray[np.float32]]:
        """The outputs in the model's order."""
        outputs: list[NDArray[np.float32]] = self._session.run(None, inputs)
        return outputs


def _provider(path: Path, provider: str) -> str:
    name = _PROVIDERS.get(provider)
    available = onnxruntime.get_available_providers()
    if name is None or name not in available:
        usable = [key for key, value in _PROVIDERS.items() if value in available]
        raise InputError(path, f"provider {provider!r}", f"one that is installed: {', '.join(usable)}")
    return name


def _options(threads: int) -> onnxruntime.SessionOptions:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = _QUIET
    # machines are shared with the other detectors: a waiting thread must not burn its core
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    return options

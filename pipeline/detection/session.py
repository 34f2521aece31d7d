"""ONNX Runtime sessions: the one place that opens a model."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

# Unless told before its import, the library writes a device id into the home folder and reports usage.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"
import onnxruntime

from pipeline.detection.facts import Signature, Tensor
from pipeline.detection.folding import folded
from pipeline.errors import InputError

_PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}
_QUIET = 4
_DTYPES = {"float": "float32", "double": "float64"}


class Session:
    """An open model. One operator at a time, on so many threads, with the same result each time."""

    def __init__(self, path: Path, threads: int, provider: str) -> None:
        """Raises InputError for a missing file, one that is not ONNX, or a provider that is not installed."""
        if not path.is_file():
            raise InputError(path, "no file", "a detector as an ONNX file")
        name = _provider(path, provider)
        try:
            self._session = _open(path, threads, name)
        except Exception as error:  # ONNX Runtime's errors have no common root
            found = f"a file that is not a usable ONNX model ({_reason(error)})"
            raise InputError(
                path, found, "an ONNX model, with its external data beside it if it has any"
            ) from None
        meta = self._session.get_modelmeta().custom_metadata_map
        self.signature = Signature(
            tuple(_tensor(t) for t in self._session.get_inputs()),
            tuple(_tensor(t) for t in self._session.get_outputs()),
            dict(meta),
        )
        #: where it runs and on how many threads, as it was opened
        self.provider, self.threads = provider, threads
        self._path = path
        self._names = [t.name for t in self.signature.outputs]

    def run(self, inputs: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """The outputs by name. Raises InputError if the model fails on them."""
        try:
            return dict(zip(self._names, self._session.run(None, dict(inputs)), strict=True))
        except Exception as error:
            found = f"a model that fails on a picture ({_reason(error)})"
            raise InputError(self._path, found, "a model that runs in ONNX Runtime") from None


def _open(path: Path, threads: int, provider: str) -> Any:
    options = _options(threads)
    session = onnxruntime.InferenceSession(path, options, providers=[provider])
    if session.get_overridable_initializers():
        # weights that are listed as inputs too are no constants: nothing is folded into them, fused with them
        options.add_session_config_entry(
            "session.model_external_initializers_file_folder_path", str(path.resolve().parent)
        )
        session = onnxruntime.InferenceSession(folded(path.read_bytes()), options, providers=[provider])
    if session.get_providers()[0] != provider:
        raise ValueError(f"{provider} could not be started")
    return session


def _tensor(argument: Any) -> Tensor:
    kind = argument.type.removeprefix("tensor(").removesuffix(")")
    return Tensor(argument.name, tuple(argument.shape), _DTYPES.get(kind, kind))


def _reason(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text[:200] or type(error).__name__


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

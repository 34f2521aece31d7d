"""A network in a process of its own: what ends that process ends its substreams, and no others of its machine.

The picture lies in memory that both processes see; what goes between them is small: the picture's size, and what was
found. Both ends are ours: the child is told what to load by its parent alone, and its answers are numbers.
"""

from __future__ import annotations

import mmap
import os
import pickle
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from pipeline.config.pool import PoolDetector
from pipeline.detection import NotFiniteError, open_pool_detector
from pipeline.errors import InputError, RunFailedError, failure, in_one_line
from pipeline.messages import FloatArray
from pipeline.sensor.setup import Setup

_LENGTH = struct.Struct(">I")
#: more boxes than this are no answer
_MOST_BYTES = 64 * 1024 * 1024


@dataclass(frozen=True)
class ProcessParams:
    """load_s: a network that is not loaded after so long, look_s: a picture that is not looked at, has failed."""

    load_s: float = 120.0
    look_s: float = 30.0


class DetectorProcess:
    """Looks at pictures as ``pipeline.detection.Detector`` does, in a child process. Not for two threads at once."""

    def __init__(
        self,
        detector: PoolDetector,
        layers: Mapping[str, int],
        setup: Setup | None = None,
        params: ProcessParams | None = None,
    ) -> None:
        """Load it. Raises InputError as ``open_pool_detector`` does, RunFailedError if the process ends or hangs."""
        self._name, self._params = detector.id, params or ProcessParams()
        self._memory = os.memfd_create(f"searchlight-{detector.id}")
        self._seen: mmap.mmap | None = None
        self._socket, theirs = socket.socketpair()
        with theirs:
            fds = (theirs.fileno(), self._memory)
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, *map(str, fds)],
                pass_fds=fds,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for its parent to hear
            )
        _send(self._socket, pickle.dumps((detector, dict(layers), setup)))
        self._answer(self._params.load_s)

    @property
    def pid(self) -> int:
        """Of the child."""
        return self._process.pid

    def detect(self, image: NDArray[np.uint8]) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
        """See ``Looks``. Raises NotFiniteError, and RunFailedError if the process ends or hangs."""
        if self._seen is None or len(self._seen) < image.nbytes:
            os.ftruncate(self._memory, image.nbytes)
            self._seen = mmap.mmap(self._memory, image.nbytes)
        np.frombuffer(self._seen, np.uint8, image.size)[:] = image.reshape(-1)
        try:
            _send(self._socket, msgpack.packb(image.shape))
        except OSError:
            self._has_ended()
        boxes, scores, classes = self._answer(self._params.look_s)
        return (
            np.frombuffer(boxes, np.float64).reshape(-1, 4),
            np.frombuffer(scores, np.float64),
            np.frombuffer(classes, np.int64),
        )

    def close(self) -> None:
        """End the child."""
        self._socket.close()
        self._process.kill()
        self._process.wait()
        with suppress(OSError):
            os.close(self._memory)

    def __del__(self) -> None:
        if hasattr(self, "_process"):
            self.close()

    def _answer(self, within_s: float) -> Any:
        self._socket.settimeout(within_s)
        try:
            kind, *said = msgpack.unpackb(_receive(self._socket), use_list=False)
        except TimeoutError:
            self._process.kill()
            raise RunFailedError(f"detector {self._name}: its process hangs for {within_s:g} s") from None
        except (OSError, EOFError):
            self._has_ended()
        if kind == "input":
            raise InputError(*said)
        if kind == "nan":
            raise NotFiniteError(*said)
        if kind == "failed":
            raise RunFailedError(f"detector {self._name}: {said[0]}")
        return said

    def _has_ended(self) -> None:
        code = self._process.wait()
        how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        raise RunFailedError(f"detector {self._name}: its process has ended ({how})") from None


def _send(to: socket.socket, data: bytes) -> None:
    to.sendall(_LENGTH.pack(len(data)) + data)


def _receive(from_: socket.socket) -> bytes:
    """Raises EOFError at the end."""
    (length,) = _LENGTH.unpack(_exactly(from_, _LENGTH.size))
    if length > _MOST_BYTES:
        raise EOFError(f"{length} bytes")
    return _exactly(from_, length)


def _exactly(from_: socket.socket, nbytes: int) -> bytes:
    data = bytearray()
    while len(data) < nbytes:
        piece = from_.recv(nbytes - len(data))
        if not piece:
            raise EOFError
        data += piece
    return bytes(data)


def serve(connection: socket.socket, memory: int) -> None:
    """The child: load, then look until the parent is gone."""
    try:
        # of our own parent, before anybody else could speak
        detector = open_pool_detector(*pickle.loads(_receive(connection)))
    except InputError as error:
        _send(connection, msgpack.packb(("input", str(error.where), error.found, error.expected)))
        return
    _send(connection, msgpack.packb(("ready",)))
    seen: mmap.mmap | None = None
    while True:
        try:
            shape = msgpack.unpackb(_receive(connection), use_list=False)
        except EOFError:
            return
        nbytes = int(np.prod(shape))
        if seen is None or len(seen) < nbytes:
            seen = mmap.mmap(memory, nbytes)
        image = np.frombuffer(seen, np.uint8, nbytes).reshape(shape)
        try:
            boxes, scores, classes = detector.detect(image)
            said: tuple[object, ...] = (
                "found",
                np.asarray(boxes, np.float64).tobytes(),
                np.asarray(scores, np.float64).tobytes(),
                np.asarray(classes, np.int64).tobytes(),
            )
        except NotFiniteError as error:
            said = "nan", *error.args
        except Exception as error:
            said = "failed", in_one_line(failure(error))
        _send(connection, msgpack.packb(said))


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])), int(sys.argv[2]))

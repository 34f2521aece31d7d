"""A relay on loopback that lets through what a link of a given rate would: a stand-in for a radio, without root.

It reads from the sender no faster than the rate, with little buffered on either side, so that the sender's kernel
feels it as it feels a radio. What comes back is passed on at once.
"""

from __future__ import annotations

import socket
import threading
import time
from contextlib import suppress

Address = tuple[str, int]
STEP_S = 0.005
BUFFER_BYTES = 4096


class ThrottledRelay:
    """rate_bps may be changed at any moment; 0 stops the way there, stop_back the way back. cut: both ways end, with a
    reset.
    """

    def __init__(self, target: Address, rate_bps: float) -> None:
        self.rate_bps, self.stop_back = rate_bps, False
        self._target = target
        self._listener = socket.socket()
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        self._listener.bind(("127.0.0.1", 0))
        self._listener.listen()
        self.address: Address = self._listener.getsockname()
        self._passed: list[tuple[float, int]] = []
        self._ends: list[socket.socket] = []
        self._closed = False
        threading.Thread(target=self._accept, daemon=True).start()

    def passed_bps(self, seconds: float) -> float:
        """What it really let through lately: on a busy machine its own thread is late."""
        now_s = time.monotonic()
        return sum(n for at_s, n in self._passed if at_s > now_s - seconds) * 8 / seconds

    def cut(self) -> None:
        ends, self._ends = self._ends, []
        for end in ends:
            with suppress(OSError):
                end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0")
                end.shutdown(socket.SHUT_RDWR)
                end.close()

    def close(self) -> None:
        self._closed = True
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.cut()

    def _accept(self) -> None:
        while not self._closed:
            with suppress(OSError):
                near, _ = self._listener.accept()
                far = socket.create_connection(self._target)
                far.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._ends += [near, far]
                threading.Thread(target=self._there, args=(near, far), daemon=True).start()
                threading.Thread(target=self._back, args=(near, far), daemon=True).start()

    def _there(self, near: socket.socket, far: socket.socket) -> None:
        free_s = time.monotonic()
        with suppress(OSError):
            while True:
                rate_bps = self.rate_bps
                if rate_bps <= 0.0:
                    time.sleep(STEP_S)
                    continue
                data = near.recv(max(64, min(BUFFER_BYTES, int(rate_bps / 8 * STEP_S))))
                if not data:
                    break
                # as much as four steps may be made up for: sleeps are late
                free_s = max(free_s, time.monotonic() - 4 * STEP_S) + len(data) * 8 / rate_bps
                time.sleep(max(0.0, free_s - time.monotonic()))
                far.sendall(data)
                self._passed.append((time.monotonic(), len(data)))
        with suppress(OSError):
            far.shutdown(socket.SHUT_WR)

    def _back(self, near: socket.socket, far: socket.socket) -> None:
        with suppress(OSError):
            while data := far.recv(65536):
                while self.stop_back:
                    time.sleep(STEP_S)
                near.sendall(data)
        with suppress(OSError):
            near.shutdown(socket.SHUT_WR)

"""SRT as a file of bytes: FFmpeg's part in PyAV's wheel does not know it, so tstrans speaks it.

No child process: its command line, which everybody on the machine can read, would show the passphrase.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from pipeline.config.stream_url import StreamUrl
from pipeline.ingest.live.fault import LiveFaultError

_MOST_BYTES = 1 << 16


class SrtBytes:
    """What arrives on a socket. silent: it ended since nothing came, not since the sender went."""

    name = "srt"

    def __init__(self, receiver: Any) -> None:
        self._receiver, self._left, self.silent = receiver, b"", False

    def read(self, size: int) -> bytes:
        """Some bytes, at most so many; empty at the end."""
        from tstrans.exceptions import SrtError

        if not self._left:
            try:
                self._left = self._receiver.recv_bytes(_MOST_BYTES)
            except SrtError as error:
                self.silent = _kind(error) == "TIMEOUT"
                return b""
        given, self._left = self._left[:size], self._left[size:]
        return given

    def close(self) -> None:
        """End the connection."""
        from tstrans.exceptions import SrtError

        with suppress(SrtError):
            self._receiver.close()


def open_srt(url: StreamUrl, open_s: float, read_s: float) -> SrtBytes:
    """Call a sender, or with ``mode=listener`` wait for one. Raises LiveFaultError."""
    from tstrans import srt
    from tstrans.exceptions import SrtError

    open_ms, read_ms = round(open_s * 1000), round(read_s * 1000)
    try:
        builder = srt.Builder(url.text, connect_timeout_ms=open_ms, recv_timeout_ms=read_ms)
        if url.query.get("mode") != "listener":
            return SrtBytes(builder.caller().connect().into_receiver())
        listener = builder.listener().listen()
        try:
            return SrtBytes(listener.accept(timeout_ms=open_ms).into_receiver())
        finally:
            listener.close()
    except SrtError as error:
        raise _fault(url, error, open_s) from None


def _fault(url: StreamUrl, error: Any, open_s: float) -> LiveFaultError:
    if "BadSecret" in str(error) or "rejected" in str(error):
        said = (
            "the passphrase that was given is refused"
            if "passphrase" in url.query
            else "it wants a passphrase"
        )
        return LiveFaultError(said, for_good=True)
    if _kind(error) in ("TIMEOUT", "ACCEPT_FAILED"):
        return LiveFaultError(f"nothing came within {open_s:g} s")
    return LiveFaultError(f"SRT: {_kind(error).replace('_', ' ').lower()}")


def _kind(error: Any) -> str:
    from tstrans.exceptions import SrtErrorKind

    return SrtErrorKind(error.kind).name

"""Sends Cursor-on-Target events to a TAK server or to a network, by PyTAK, and keeps them while nobody is there.

An event is known by its uid: a newer one takes the place of an older one that waits. TCP and TLS cannot say what was
read at the other end, so whatever a broken connection had carried is sent again over the next one; the same event
twice is the same marker. UDP cannot say anything.
"""

from __future__ import annotations

import asyncio
import os
import time
import warnings
from collections import OrderedDict
from collections.abc import Callable, Mapping
from configparser import ConfigParser, SectionProxy
from contextlib import suppress
from typing import Any
from urllib.parse import urlparse

from pipeline.errors import InputError

#: schemes as PyTAK is told them; of UDP it would listen too
_SCHEMES = {"tcp": "tcp", "tls": "tls", "udp": "udp+wo"}
#: events that wait, at most: of more the oldest are dropped, and counted
CAPACITY = 10_000
#: between two attempts to connect, seconds: the first, and the longest
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.25, 2.0
#: a connection that breaks within this after the last event may not have carried it, seconds
_LINGER_S = 0.3
#: an attempt to connect or to send that takes longer has failed, seconds
_TIMEOUT_S = 5.0


class CotSender:
    """Events that wait, and one connection. say: told once when nobody can be reached, and when somebody can again.

    sent: events written, again ones too. dropped: waited in vain, since more than ``capacity`` did.
    """

    def __init__(self, url: str, say: Callable[[str], None], capacity: int = CAPACITY) -> None:
        """url: ``tcp://HOST:PORT``, ``tls://..`` or ``udp://..``. Raises InputError for another."""
        self._config, self._url = _config(url), url
        self._say, self._capacity = say, capacity
        self._waiting: OrderedDict[str, bytes] = OrderedDict()
        self._carried: OrderedDict[str, bytes] = OrderedDict()
        self._news = asyncio.Event()
        self.sent, self.dropped = 0, 0

    @property
    def waiting(self) -> int:
        """Events that were not sent yet."""
        return len(self._waiting)

    def put(self, events: Mapping[str, bytes]) -> None:
        """Let events wait, by uid, in place of older ones."""
        for uid, event in events.items():
            self._waiting.pop(uid, None)
            self._carried.pop(uid, None)
            self._waiting[uid] = event
        over = len(self._waiting) - self._capacity
        for _ in range(over):
            self._waiting.popitem(last=False)
        if over > 0:
            self.dropped += over
            self._say(
                f"{self._url}: {over} of the oldest events dropped, {self.dropped} in all: too many wait"
            )
        self._news.set()

    async def run(self) -> None:
        """Send what waits and what comes, until cancelled."""
        wait_s, told = _FIRST_WAIT_S, False
        while True:
            try:
                reader, writer = await asyncio.wait_for(_connected(self._config), _TIMEOUT_S)
                if told:
                    self._say(f"{self._url}: reached; {self.waiting} events wait")
                wait_s, told = _FIRST_WAIT_S, False
                try:
                    await self._send(reader, writer)
                finally:
                    await _close(writer)
            except (OSError, TimeoutError, asyncio.IncompleteReadError) as error:
                self._again()
                if not told:
                    why = str(error) or type(error).__name__
                    self._say(f"{self._url}: not reached ({why}); {self.waiting} events wait")
                told = True
                await asyncio.sleep(wait_s)
                wait_s = min(2.0 * wait_s, _LONGEST_WAIT_S)

    async def drained(self, within_s: float) -> bool:
        """Wait until all is sent and the connection has held a while since; whether that came in time."""
        until_s, quiet_since_s = time.monotonic() + within_s, None
        while time.monotonic() < until_s:
            await asyncio.sleep(0.02)
            if self._waiting:
                quiet_since_s = None
                continue
            quiet_since_s = quiet_since_s or time.monotonic()
            if time.monotonic() - quiet_since_s >= _LINGER_S:
                return True
        return False

    async def _send(self, reader: Any, writer: Any) -> None:
        """Send until the connection breaks. Raises OSError then."""
        worker = _worker(self._config, writer)
        broken = asyncio.ensure_future(_until_closed(reader))
        try:
            while True:
                while self._waiting and not broken.done():
                    uid, event = next(iter(self._waiting.items()))
                    await asyncio.wait_for(worker.send_data(event), _TIMEOUT_S)
                    self.sent += 1
                    if self._waiting.get(uid) is event:
                        del self._waiting[uid]
                        self._carried[uid] = event
                        while len(self._carried) > self._capacity:
                            self._carried.popitem(last=False)
                if broken.done():
                    raise ConnectionResetError("the connection was closed")
                self._news.clear()
                news = asyncio.ensure_future(self._news.wait())
                await asyncio.wait({news, broken}, return_when=asyncio.FIRST_COMPLETED)
                news.cancel()
        finally:
            broken.cancel()

    def _again(self) -> None:
        """What a broken connection had carried waits again, before what is newer."""
        self._waiting = OrderedDict(self._carried | self._waiting)
        self._carried = OrderedDict()


def _config(url: str) -> SectionProxy:
    """PyTAK's settings: the url, and what the environment says of TLS (PYTAK_TLS_CLIENT_CERT and others)."""
    expected = "tcp://HOST:PORT, tls://HOST:PORT or udp://HOST:PORT"
    try:
        parts = urlparse(url)
        port = parts.port
    except ValueError:
        raise InputError("--send", repr(url), expected) from None
    if parts.scheme not in _SCHEMES or not parts.hostname or port is None or parts.username is not None:
        raise InputError("--send", repr(url), expected)
    settings = {name: value for name, value in os.environ.items() if name.startswith("PYTAK_TLS_")}
    if parts.scheme == "tls" and "PYTAK_TLS_CLIENT_CERT" not in settings:
        found = "no PYTAK_TLS_CLIENT_CERT in the environment"
        raise InputError("--send", found, "the client's certificate (PEM or .p12), as PyTAK's manual says")
    for name in ("PYTAK_TLS_CLIENT_CERT", "PYTAK_TLS_CLIENT_KEY", "PYTAK_TLS_CLIENT_CAFILE"):
        if parts.scheme == "tls" and name in settings and not os.path.isfile(settings[name]):
            raise InputError(name, settings[name], "a file that is there")
    config = ConfigParser(interpolation=None)
    config["send"] = settings | {"COT_URL": f"{_SCHEMES[parts.scheme]}://{parts.netloc}", "TAK_PROTO": "0"}
    return config["send"]


async def _connected(config: SectionProxy) -> tuple[Any, Any]:
    with warnings.catch_warnings():
        # of parts of PyTAK that need more packages, which are not used
        warnings.simplefilter("ignore")
        import pytak
    try:
        pair = await pytak.protocol_factory(config)
    except (SyntaxError, ValueError) as error:
        # PyTAK's words for certificates that cannot be used: they do not mend themselves
        raise InputError("--send", str(error)[:200], "certificates that can be used") from None
    return pair[0], pair[1]


def _worker(config: SectionProxy, writer: Any) -> Any:
    import pytak

    return pytak.TXWorker(asyncio.Queue(), config, writer)


async def _until_closed(reader: Any) -> None:
    """Read and forget what a server sends, until it closes; for ever of UDP."""
    if not hasattr(reader, "read"):
        await asyncio.Event().wait()
    with suppress(OSError):
        while await reader.read(65_536):
            pass


async def _close(writer: Any) -> None:
    with suppress(OSError, TimeoutError):
        writer.close()
        if hasattr(writer, "wait_closed"):
            await asyncio.wait_for(writer.wait_closed(), _TIMEOUT_S)

"""How a connection begins: both ends show the version of their wire form and prove that they hold their keys.

Server: ``SLNK`` and the version (5 bytes), at once. Client: the same, and the first message of the key agreement
(``pipeline.link.noise``, 96 bytes). Server, if it knows the client's key: the second message (48 bytes). Client: an
empty record, without which a first message that somebody has recorded and sends again would open a connection. The two
hellos are the prologue of the agreement: who changes one of them ends it. To a stranger a server says its version, and
no more.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from dataclasses import dataclass

from pipeline.errors import ProtocolError
from pipeline.link.keys import KeyPair
from pipeline.link.noise import FIRST_BYTES, SECOND_BYTES, Initiator, Responder
from pipeline.link.records import HEARTBEAT, OVERHEAD_BYTES, RecordReader, RecordWriter
from pipeline.messages import WIRE_VERSION

_MAGIC = b"SLNK"
HELLO = _MAGIC + bytes([WIRE_VERSION])
_PROLOGUE = HELLO + HELLO


@dataclass(frozen=True, slots=True)
class Session:
    """The two directions of a connection whose ends have proven who they are."""

    writer: RecordWriter
    reader: RecordReader


def connect(connection: socket.socket, keys: KeyPair, server: bytes, timeout_s: float = 5.0) -> Session:
    """The client's side. server: the public key that the other end has to hold.

    Raises ProtocolError if it does not, does not know ours, or is of another version; OSError if it goes away or takes
    longer.
    """
    until_s = time.monotonic() + timeout_s
    agreement = Initiator(_PROLOGUE, keys.private, server)
    _send(connection, HELLO + agreement.first(), until_s)
    require_version(_receive(connection, len(HELLO), until_s))
    _, sending, receiving = agreement.second(_receive(connection, SECOND_BYTES, until_s))
    session = Session(RecordWriter(sending), RecordReader(receiving))
    _send(connection, session.writer.seal(HEARTBEAT), until_s)
    connection.settimeout(None)
    return session


class Greeting:
    """The server's side, without a socket: ``take`` what came, send what it says; ``session`` once it is done.

    name_of(key): of a client whose key is to be accepted; None for a stranger, who may become known, see
    ``look_again``; it raises ProtocolError for one who will not.
    """

    def __init__(self, keys: KeyPair, name_of: Callable[[bytes], str | None]) -> None:
        self._name_of = name_of
        self._agreement = Responder(_PROLOGUE, keys.private)
        self._came = b""
        self._opened: Session | None = None
        self.name: str | None = None
        self.session: Session | None = None

    @property
    def key(self) -> bytes:
        """The client's, once it has shown it; empty before."""
        return self._agreement.remote

    @property
    def wanted_bytes(self) -> int:
        """How many bytes it can take now: none that belong to what comes after it."""
        if self._opened is not None:
            return OVERHEAD_BYTES - len(self._came)
        if self.key:  # of a stranger nothing more is read
            return 0
        return (len(HELLO) if len(self._came) < len(HELLO) else len(HELLO) + FIRST_BYTES) - len(self._came)

    def take(self, data: bytes) -> bytes:
        """At most ``wanted_bytes``; what is to be said. Raises ProtocolError for a client that is none of ours."""
        self._came += data
        if self._opened is not None:
            return self._confirmed(self._opened)
        if len(self._came) == len(HELLO):
            require_version(self._came)
        if len(self._came) < len(HELLO) + FIRST_BYTES:
            return b""
        self._agreement.first(self._came[len(HELLO) :])
        return self.look_again()

    def look_again(self) -> bytes:
        """What is to be said now to one who was a stranger when it came, and may be known by now."""
        if not self.key or self._opened is not None:
            return b""
        self.name = self._name_of(self.key)
        if self.name is None:
            return b""
        answer, sending, receiving = self._agreement.second()
        self._opened = Session(RecordWriter(sending), RecordReader(receiving))
        self._came = b""
        return answer

    def _confirmed(self, session: Session) -> bytes:
        if len(self._came) == OVERHEAD_BYTES:
            session.reader.feed(self._came)
            if not session.reader.heard:
                raise ProtocolError("a connection that does not begin with an empty record", "not_authentic")
            self.session = session
        return b""


def require_version(hello: bytes) -> None:
    """Raises ProtocolError if the other end is of another version, or no Searchlight."""
    if hello == HELLO:
        return
    if hello[: len(_MAGIC)] == _MAGIC:
        found = f"speaks version {hello[-1]} of the wire form"
    else:
        found = f"is no Searchlight of this release (it began with {hello!r})"
    raise ProtocolError(
        f"the other end of a link {found}; expected version {WIRE_VERSION}: the same release at both ends",
        "version",
    )


def _send(connection: socket.socket, data: bytes | bytearray, until_s: float) -> None:
    _limit(connection, until_s)
    connection.sendall(data)


def _receive(connection: socket.socket, nbytes: int, until_s: float) -> bytes:
    data = b""
    while len(data) < nbytes:
        _limit(connection, until_s)
        piece = connection.recv(nbytes - len(data))
        if not piece:
            raise ProtocolError("the other end of a link does not accept our key: it closed the connection")
        data += piece
    return data


def _limit(connection: socket.socket, until_s: float) -> None:
    """Of the whole exchange: a peer that sends a byte now and then must not hold it open."""
    left_s = until_s - time.monotonic()
    if left_s <= 0.0:
        raise TimeoutError("the other end of a link did not prove its key in time")
    connection.settimeout(left_s)

"""Both ends of a connection prove that they speak the same wire form and hold the same token, without showing it.

Each end first says ``SLNK`` and the version of its wire form. Server: 32 random bytes. Client: 32 random bytes, the
length of its name (1 byte), its name, and HMAC-SHA256(token, "client" + all said so far). Server: the same of "server".
"""

from __future__ import annotations

import hmac
import secrets
import socket
import time

from pipeline.errors import ProtocolError
from pipeline.messages import WIRE_VERSION

_MAGIC = b"SLNK"
_HELLO = _MAGIC + bytes([WIRE_VERSION])
_NONCE_BYTES = 32
_PROOF_BYTES = 32
_MOST_NAME_BYTES = 255


def accept(connection: socket.socket, token: bytes, timeout_s: float = 5.0) -> str:
    """The server's side; the client's name.

    Raises ProtocolError for a peer without the token or of another version, OSError if it goes away or takes longer.
    """
    until_s = time.monotonic() + timeout_s
    challenge = secrets.token_bytes(_NONCE_BYTES)
    _send(connection, _HELLO + challenge, until_s)
    _require_version(_receive(connection, len(_HELLO), until_s))
    head = _receive(connection, _NONCE_BYTES + 1, until_s)
    name = _receive(connection, head[-1], until_s)
    said = _HELLO + challenge + head + name
    _require(token, b"client", said, _receive(connection, _PROOF_BYTES, until_s))
    _send(connection, _proof(token, b"server", said), until_s)
    connection.settimeout(None)
    return name.decode(errors="replace")


def connect(connection: socket.socket, token: bytes, name: str = "", timeout_s: float = 5.0) -> None:
    """The client's side; name: of who it is, for the server's log. Raises as accept does."""
    until_s = time.monotonic() + timeout_s
    own_name = name.encode()[:_MOST_NAME_BYTES]
    own = secrets.token_bytes(_NONCE_BYTES) + bytes([len(own_name)]) + own_name
    _require_version(_receive(connection, len(_HELLO), until_s))
    said = _HELLO + _receive(connection, _NONCE_BYTES, until_s) + own
    _send(connection, _HELLO + own + _proof(token, b"client", said), until_s)
    _require(token, b"server", said, _receive(connection, _PROOF_BYTES, until_s))
    connection.settimeout(None)


def _require_version(hello: bytes) -> None:
    if hello == _HELLO:
        return
    if hello[: len(_MAGIC)] == _MAGIC:
        found = f"speaks version {hello[-1]} of the wire form"
    else:
        found = f"is no Searchlight of this release (it began with {hello!r})"
    raise ProtocolError(
        f"the other end of a link {found}; expected version {WIRE_VERSION}: the same release at both ends"
    )


def _proof(token: bytes, role: bytes, said: bytes) -> bytes:
    return hmac.digest(token, role + said, "sha256")


def _require(token: bytes, role: bytes, said: bytes, proof: bytes) -> None:
    if not hmac.compare_digest(proof, _proof(token, role, said)):
        raise ProtocolError(f"the {role.decode()} of a link does not hold the token")


def _send(connection: socket.socket, data: bytes, until_s: float) -> None:
    _limit(connection, until_s)
    connection.sendall(data)


def _receive(connection: socket.socket, nbytes: int, until_s: float) -> bytes:
    data = b""
    while len(data) < nbytes:
        _limit(connection, until_s)
        piece = connection.recv(nbytes - len(data))
        if not piece:
            raise ProtocolError("the other end of a link does not hold the token: it closed the connection")
        data += piece
    return data


def _limit(connection: socket.socket, until_s: float) -> None:
    """Of the whole exchange: a peer that sends a byte now and then must not hold it open."""
    left_s = until_s - time.monotonic()
    if left_s <= 0.0:
        raise TimeoutError("the other end of a link did not prove its token in time")
    connection.settimeout(left_s)

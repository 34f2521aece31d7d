"""Both ends of a connection prove that they hold the same token, without showing it.

Server: 32 random bytes. Client: 32 random bytes and HMAC-SHA256(token, "client" + both).
Server: HMAC-SHA256(token, "server" + both).
"""

from __future__ import annotations

import hmac
import secrets
import socket

from pipeline.errors import ProtocolError

_NONCE_BYTES = 32
_PROOF_BYTES = 32
_TIMEOUT_S = 5.0


def accept(connection: socket.socket, token: bytes) -> None:
    """The server's side. Raises ProtocolError for a peer without the token, OSError if it goes away."""
    connection.settimeout(_TIMEOUT_S)
    challenge = secrets.token_bytes(_NONCE_BYTES)
    connection.sendall(challenge)
    answer = _receive(connection, _NONCE_BYTES + _PROOF_BYTES)
    nonces = challenge + answer[:_NONCE_BYTES]
    _require(token, b"client", nonces, answer[_NONCE_BYTES:])
    connection.sendall(_proof(token, b"server", nonces))
    connection.settimeout(None)


def connect(connection: socket.socket, token: bytes) -> None:
    """The client's side. Raises ProtocolError for a peer without the token, OSError if it goes away."""
    connection.settimeout(_TIMEOUT_S)
    own = secrets.token_bytes(_NONCE_BYTES)
    nonces = _receive(connection, _NONCE_BYTES) + own
    connection.sendall(own + _proof(token, b"client", nonces))
    _require(token, b"server", nonces, _receive(connection, _PROOF_BYTES))
    connection.settimeout(None)


def _proof(token: bytes, role: bytes, nonces: bytes) -> bytes:
    return hmac.digest(token, role + nonces, "sha256")


def _require(token: bytes, role: bytes, nonces: bytes, proof: bytes) -> None:
    if not hmac.compare_digest(proof, _proof(token, role, nonces)):
        raise ProtocolError(f"the {role.decode()} of a link does not hold the token")


def _receive(connection: socket.socket, nbytes: int) -> bytes:
    data = b""
    while len(data) < nbytes:
        piece = connection.recv(nbytes - len(data))
        if not piece:
            raise ProtocolError("the other end of a link does not hold the token: it closed the connection")
        data += piece
    return data

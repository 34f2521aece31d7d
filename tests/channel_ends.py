"""The two ends of a channel as tests make them: raw sockets that hold real keys, and pairs without a socket."""

from __future__ import annotations

import socket

from pipeline.link.handshake import HELLO, Greeting, Session, connect
from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.noise import CipherState
from pipeline.link.records import RecordReader, RecordWriter


def one_way(key: bytes = bytes(32), **more: int) -> tuple[RecordWriter, RecordReader]:
    """What one end seals, the other end reads."""
    return RecordWriter(CipherState(key), **more), RecordReader(CipherState(key), **more)


def greet(connection: socket.socket, keys: KeyPair, peers: dict[bytes, str]) -> Session:
    """The server's side of a handshake, on a socket that blocks."""
    greeting = Greeting(keys, peers.get)
    connection.sendall(HELLO)
    while greeting.session is None:
        said = connection.recv(greeting.wanted_bytes)
        assert said, "the client went away"
        connection.sendall(greeting.take(said))
    return greeting.session


def known_to(endpoint: Endpoint, keys: KeyPair, timeout_s: float = 20.0) -> tuple[socket.socket, Session]:
    """A raw connection to a receiver that has let it in."""
    connection = socket.create_connection(endpoint.address, timeout=timeout_s)
    session = connect(connection, keys, endpoint.key)
    connection.settimeout(timeout_s)
    return connection, session

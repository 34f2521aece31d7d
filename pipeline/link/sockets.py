"""What both ends of a link do with a socket."""

from __future__ import annotations

import socket
from contextlib import suppress


def shut_down(endpoint: socket.socket) -> None:
    """Wake whoever blocks on a socket; closing it alone would not."""
    with suppress(OSError):  # not connected any more
        endpoint.shutdown(socket.SHUT_RDWR)


def hold_at_most(connection: socket.socket, nbytes: int) -> None:
    """Limit what the kernel takes before it is sent and confirmed; Linux books about as much again for itself."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, nbytes)

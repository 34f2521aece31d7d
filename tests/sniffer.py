"""Runs in a network namespace, as root: writes all that passes on an interface to a file, until it is told to stop.

    python tests/sniffer.py INTERFACE FILE

Prints a line once it listens, and ends when its standard input does.
"""

from __future__ import annotations

import select
import socket
import sys

_ALL_PROTOCOLS = 0x0003


def main(interface: str, path: str) -> None:
    listening = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_ALL_PROTOCOLS))
    listening.setsockopt(socket.SOL_SOCKET, 33, 64 * 1024 * 1024)  # SO_RCVBUFFORCE
    listening.bind((interface, 0))
    print("listening", flush=True)
    with open(path, "wb", buffering=0) as file:
        while True:
            ready, _, _ = select.select([listening, sys.stdin], [], [])
            if listening in ready:
                file.write(listening.recv(70_000))
            elif not sys.stdin.readline():
                return


if __name__ == "__main__":
    main(*sys.argv[1:])

"""A network namespace that leads nowhere and tells what wanted to leave it: names that were asked for, and packets.

Loopback works in it. A name server there writes down every name that it is asked for, and answers with an address that
is routed into a device nobody reads; what is sent to any address outside goes there too, and is written down.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: of the documentation range of RFC 5737, so nobody's; the device's own address is one of them
ANSWER, OWN = "198.51.100.7", "198.51.100.1"
#: after a command has ended: what it sent last is still being written down
_LAST_S = 0.3

#: a name server, in the namespace: writes each name to the file that it is given
_RESOLVER = f"""
import socket, sys
server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
server.bind(("127.0.0.1", 53))
print("listening", flush=True)
while True:
    asked, client = server.recvfrom(4096)
    at, labels = 12, []
    while asked[at]:
        labels.append(asked[at + 1 : at + 1 + asked[at]].decode("ascii", "replace"))
        at += 1 + asked[at]
    end, kind = at + 5, asked[at + 1 : at + 3]
    with open(sys.argv[1], "a") as file:
        print(".".join(labels), file=file)
    found = kind == b"\\0\\1"
    head = asked[:2] + b"\\x81\\x80\\0\\1" + (b"\\0\\1" if found else b"\\0\\0") + b"\\0\\0\\0\\0"
    answer = b"\\xc0\\x0c\\0\\1\\0\\1\\0\\0\\0\\x01\\0\\4" + socket.inet_aton("{ANSWER}") if found else b""
    server.sendto(head + asked[12:end] + answer, client)
"""


@dataclass(frozen=True)
class Wanted:
    """names: that were asked for. packets: bytes that were sent to addresses outside."""

    names: tuple[str, ...]
    packets: int

    @property
    def nothing(self) -> bool:
        """Whether nobody wanted to leave."""
        return not self.names and not self.packets


@dataclass
class WatchedNetwork:
    """namespace: its name. folder: where what was wanted is written down."""

    namespace: str
    folder: Path

    def run(
        self, *command: str, env: Mapping[str, str] | None = None, timeout_s: float = 240.0
    ) -> subprocess.CompletedProcess[str]:
        """A command in it, from the project's root."""
        words = ["ip", "netns", "exec", self.namespace, *command]
        return subprocess.run(
            words, cwd=ROOT, env=env, capture_output=True, text=True, timeout=timeout_s, check=False
        )

    @property
    def wanted(self) -> Wanted:
        """What wanted to leave so far."""
        time.sleep(_LAST_S)
        names = self._names.read_text().split() if self._names.exists() else []
        return Wanted(tuple(names), self._packets.stat().st_size)

    @property
    def _names(self) -> Path:
        return self.folder / "names"

    @property
    def _packets(self) -> Path:
        return self.folder / "packets"

    def _start(self, *command: str) -> subprocess.Popen[str]:
        pipe = subprocess.PIPE
        words = ["ip", "netns", "exec", self.namespace, sys.executable, *command]
        process = subprocess.Popen(words, cwd=ROOT, stdin=pipe, stdout=pipe, text=True)
        assert process.stdout is not None
        assert process.stdout.readline() == "listening\n"
        return process

    def watch(self) -> list[subprocess.Popen[str]]:
        """Who writes it down: end them after use."""
        sniffer = self._start("tests/sniffer.py", "away", str(self._packets))
        return [sniffer, self._start("-c", _RESOLVER, str(self._names))]


@contextmanager
def watched_network(folder: Path, namespace: str = "sl-watched") -> Iterator[WatchedNetwork]:
    """Needs root. folder: for what is written down."""
    settings = Path("/etc/netns") / namespace
    watchers: list[subprocess.Popen[str]] = []

    def ip(*words: str) -> None:
        subprocess.run(["ip", "-n", namespace, *words], check=True, capture_output=True)

    settings.mkdir(parents=True, exist_ok=True)
    # ip netns exec shows this file as /etc/resolv.conf
    (settings / "resolv.conf").write_text("nameserver 127.0.0.1\noptions timeout:1 attempts:1\n")
    try:
        subprocess.run(["ip", "netns", "add", namespace], check=True, capture_output=True)
        ip("link", "set", "lo", "up")
        ip("link", "add", "away", "type", "veth", "peer", "name", "nobody")
        for device in ("away", "nobody"):  # IPv6 would speak by itself
            quiet = f"net.ipv6.conf.{device}.disable_ipv6=1"
            words = ["ip", "netns", "exec", namespace, "sysctl", "-qw", quiet]
            subprocess.run(words, check=False, capture_output=True)
        ip("link", "set", "nobody", "arp", "off", "up")
        ip("addr", "add", f"{OWN}/24", "dev", "away")
        ip("link", "set", "away", "arp", "off", "up")
        ip("route", "add", "default", "dev", "away")
        network = WatchedNetwork(namespace, folder)
        watchers += network.watch()
        yield network
    finally:
        for watcher in watchers:
            watcher.kill()
            watcher.wait()
        subprocess.run(["ip", "netns", "del", namespace], capture_output=True, check=False)
        (settings / "resolv.conf").unlink(missing_ok=True)
        settings.rmdir()

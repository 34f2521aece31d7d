"""Three hosts on one machine: network namespaces of their own addresses, joined by a bridge, a Ray node on each."""

from __future__ import annotations

import os
import secrets
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: name of the namespace -> its address and the sites that it plays
HOSTS = {"g": ("10.99.0.1", "ground"), "d1": ("10.99.0.11", "drone-1"), "d2": ("10.99.0.12", "drone-2")}
PORT = 6379


def refused() -> str | None:
    """Why there can be no hosts here; None if there can."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    probe = f"slt-probe-{os.getpid()}"  # the processes of a test run all try, at the same moment
    made = subprocess.run(["ip", "netns", "add", probe], capture_output=True, check=False)
    subprocess.run(["ip", "netns", "del", probe], capture_output=True, check=False)
    return None if made.returncode == 0 else f"no network namespaces here: {made.stderr.decode().strip()}"


@dataclass
class Hosts:
    """tag: of this set of namespaces, of which there may be several. environment: of all that runs on them. tls: where
    each has its certificates.
    """

    tag: str
    environment: dict[str, str]
    tls: Path

    def on(self, host: str, *command: str) -> list[str]:
        """The command as one that runs on a host."""
        return ["ip", "netns", "exec", f"{self.tag}-{host}", *command]

    def ip(self, host: str, *words: str) -> None:
        """``ip`` on a host."""
        subprocess.run(self.on(host, "ip", *words), check=True, capture_output=True)

    def cut(self, drone: str, *, up: bool = False) -> None:
        """Take a drone off the network, or let it on again."""
        self.ip("g", "link", "set", f"slv-{drone}", "up" if up else "down")

    def kill_all(self, host: str) -> None:
        """End everything that runs on a host at once, as if its power were gone."""
        held = subprocess.run(
            ["ip", "netns", "pids", f"{self.tag}-{host}"], capture_output=True, text=True, check=True
        )
        subprocess.run(["kill", "-9", *held.stdout.split()], capture_output=True, check=False)

    def weaken(self, drone: str, rate: str) -> None:
        """What a drone sends passes no faster than this (``tc``'s words, such as 1mbit)."""
        tbf = ["tbf", "rate", rate, "burst", "16kb", "latency", "100ms"]
        command = self.on(drone, "tc", "qdisc", "replace", "dev", "eth0", "root", *tbf)
        subprocess.run(command, check=True, capture_output=True)

    def strengthen(self, drone: str) -> None:
        """Take ``weaken`` back."""
        command = self.on(drone, "tc", "qdisc", "del", "dev", "eth0", "root")
        subprocess.run(command, check=False, capture_output=True)

    def start_node(self, host: str, shown: Mapping[Path, Path] | None = None, **variables: str) -> None:
        """Join a Ray node, as a team would: deployments/ray-node.sh. shown: folders that only this host sees in the
        place of others: path -> what is there. variables: of its environment.
        """
        binds = "".join(f"mount --bind '{real}' '{path}' && " for path, real in (shown or {}).items())
        address, sites = HOSTS[host]
        head = ["--head", f"--port={PORT}"] if host == "g" else [f"--address={HOSTS['g'][0]}:{PORT}"]
        command = ["deployments/ray-node.sh", *head, f"--node-ip-address={address}", "--num-cpus=2"]
        # what ip runs has a mount namespace of its own
        subprocess.run(
            self.on(host, "sh", "-c", f'{binds}exec "$@"', "sh", *command, "--object-store-memory=100000000"),
            cwd=ROOT,
            env=self.environment
            | {"SEARCHLIGHT_SITES": sites, "SEARCHLIGHT_TLS": str(self.tls / address)}
            | variables,
            check=True,
            capture_output=True,
            timeout=120,
        )

    @contextmanager
    def overheard(self, file: Path) -> Iterator[None]:
        """Within it all that goes over the bridge is written to a file: what somebody with a radio hears."""
        command = self.on("g", sys.executable, "tests/sniffer.py", "br0", str(file))
        pipe = subprocess.PIPE
        sniffer = subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True)
        assert sniffer.stdin is not None
        assert sniffer.stdout is not None
        assert sniffer.stdout.readline() == "listening\n"
        try:
            yield
        finally:
            sniffer.stdin.close()
            sniffer.wait(30)

    def command_lines(self) -> bytes:
        """Of all processes on the hosts, as ``ps`` shows them to everybody."""
        lines = []
        for host in HOSTS:
            held = subprocess.run(self.on(host, "ps", "axww", "-o", "args"), capture_output=True, check=True)
            lines.append(held.stdout)
        return b"".join(lines)

    def searchlight(self, *arguments: str) -> subprocess.Popen[str]:
        """The command on the ground station."""
        command = [sys.executable, "-m", "actors", *arguments, "--address", f"{HOSTS['g'][0]}:{PORT}"]
        return subprocess.Popen(
            self.on("g", *command),
            cwd=ROOT,
            env=self.environment | {"SEARCHLIGHT_TLS": str(self.tls / HOSTS["g"][0])},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )


@contextmanager
def three_hosts(
    tag: str = "slt",
    shown: Mapping[str, Mapping[Path, Path]] | None = None,
    variables: Mapping[str, Mapping[str, str]] | None = None,
) -> Iterator[Hosts]:
    """The hosts with their nodes; afterwards nothing of them is left. shown, variables: by host, see start_node."""
    environment = os.environ | {
        "RAY_AUTH_MODE": "token",
        "RAY_AUTH_TOKEN": secrets.token_hex(32),
        "RAY_USAGE_STATS_ENABLED": "0",
        "PYTHONPATH": str(ROOT),
        "SEARCHLIGHT_PYTHON": sys.executable,
    }
    with tempfile.TemporaryDirectory(prefix="slt-tls-") as tls:
        hosts = Hosts(tag, environment, Path(tls))
        addresses = [address for address, _ in HOSTS.values()]
        certificates = ["deployments/certificates.sh", tls, *addresses]
        subprocess.run(certificates, cwd=ROOT, check=True, capture_output=True)
        try:
            _wire(hosts)
            for host in HOSTS:
                hosts.start_node(host, (shown or {}).get(host), **(variables or {}).get(host, {}))
            yield hosts
        finally:
            _end(hosts)


def _wire(hosts: Hosts) -> None:
    for host in HOSTS:
        subprocess.run(["ip", "netns", "add", f"{hosts.tag}-{host}"], check=True, capture_output=True)
        hosts.ip(host, "link", "set", "lo", "up")
    hosts.ip("g", "link", "add", "br0", "type", "bridge")
    hosts.ip("g", "link", "set", "br0", "type", "bridge", "forward_delay", "0")
    hosts.ip("g", "addr", "add", f"{HOSTS['g'][0]}/24", "dev", "br0")
    hosts.ip("g", "link", "set", "br0", "up")
    for host in HOSTS:
        if host == "g":
            continue
        hosts.ip("g", "link", "add", f"slv-{host}", "type", "veth", "peer", "name", "eth0", "netns",
                 f"{hosts.tag}-{host}")  # fmt: skip
        hosts.ip("g", "link", "set", f"slv-{host}", "master", "br0", "up")
        hosts.ip(host, "addr", "add", f"{HOSTS[host][0]}/24", "dev", "eth0")
        hosts.ip(host, "link", "set", "eth0", "up")


def _end(hosts: Hosts) -> None:
    """End what runs in the namespaces, by the process ids that they hold, and take them down."""
    for host in HOSTS:
        name = f"{hosts.tag}-{host}"
        for number in (15, 9):
            held = subprocess.run(["ip", "netns", "pids", name], capture_output=True, text=True, check=False)
            for pid in held.stdout.split():
                subprocess.run(["kill", f"-{number}", pid], capture_output=True, check=False)
            time.sleep(0.5)
        subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)

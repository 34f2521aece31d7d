"""What the processes of a run listen on."""

from __future__ import annotations

import ipaddress
import os
import re
from contextlib import suppress
from pathlib import Path

_LISTENS = "0A"


def family(pid: int) -> set[int]:
    """A process and all that it has started."""
    parent: dict[int, int] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parent[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
    found, before = {pid}, set[int]()
    while found != before:
        before, found = found, found | {child for child, of in parent.items() if of in found}
    return found


def listening(pid: int) -> dict[tuple[str, int], str]:
    """Address and port of each TCP socket that a process, or one that it has started, listens on; and whose it is."""
    sockets: dict[str, str] = {}
    for one in family(pid):
        with suppress(OSError):
            name = Path(f"/proc/{one}/comm").read_text().strip()
            for link in Path(f"/proc/{one}/fd").iterdir():
                with suppress(OSError):
                    inode = re.fullmatch(r"socket:\[(\d+)\]", os.readlink(link))
                    if inode:
                        sockets[inode[1]] = name
    found = {}
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == _LISTENS and words[9] in sockets:
                host, _, port = words[1].partition(":")
                found[_address(host), int(port, 16)] = sockets[words[9]]
    return found


def _address(written: str) -> str:
    """Of /proc: words of 32 bits, each with its bytes reversed."""
    words = [bytes.fromhex(written[k : k + 8])[::-1] for k in range(0, len(written), 8)]
    address = ipaddress.ip_address(b"".join(words))
    mapped = getattr(address, "ipv4_mapped", None)
    return str(mapped or address)

"""The command ``searchlight node-metrics``."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path

from actors.metrics import serve
from actors.node_metrics import NodeCollector
from actors.terminal import say

_SITE_FILE = Path("/etc/searchlight/site")


def serve_node(port: int, host: str) -> None:
    """Until it is told to end. The sites are those that deployments/ray-node.sh takes."""
    said = os.environ.get("SEARCHLIGHT_SITES")
    if said is None:
        said = _SITE_FILE.read_text(encoding="utf-8") if _SITE_FILE.is_file() else ""
    server = serve(NodeCollector(said.split()), port, host)
    say(f"metrics of this node: http://{host}:{server.server_port}/metrics")
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    ended.wait()
    server.shutdown()
    server.server_close()

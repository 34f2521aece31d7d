"""The command ``searchlight view``: show a run, finished or flying, in a browser."""

from __future__ import annotations

import secrets
import socket
from pathlib import Path

import uvicorn

from actors.terminal import say
from actors.view.app import Viewer, view_app
from actors.view.guard import LOOPBACK
from pipeline.errors import InputError
from pipeline.view.coco import write_coco


def view_run(run: Path, host: str, port: int) -> None:
    """Serve until somebody stops it. Raises InputError without a run, or where nothing can be served."""
    token = None if host in LOOPBACK else secrets.token_urlsafe(24)
    app = view_app(run, token)
    listening = _listen(host, port)
    shown = f"[{host}]" if ":" in host else host
    address = f"http://{shown}:{listening.getsockname()[1]}/"
    say(f"{run} at {address}{'' if token is None else f'?token={token}'} (Ctrl-C ends it)")
    config = uvicorn.Config(app, log_level="warning", access_log=False, server_header=False)
    uvicorn.Server(config).run(sockets=[listening])


def export_decided(run: Path, folder: Path) -> None:
    """Write what was decided for training. Raises InputError without a run."""
    viewer = Viewer(run)
    written, missing = write_coco(folder, viewer.page().places, viewer.crop)
    said = f"{written} pictures of confirmed and rejected places in {folder}"
    say(f"{said}; of {missing} the video is gone" if missing else said)


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
    except (OSError, OverflowError) as error:
        listening.close()
        found = f"{host}:{port}, which cannot be served ({getattr(error, 'strerror', None) or error})"
        raise InputError("--host, --port", found, "an interface of this machine and a free port") from None
    return listening

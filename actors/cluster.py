"""Attach to a Ray cluster, or start one on loopback that ends with the run and leaves nothing behind."""

from __future__ import annotations

import logging
import os
import secrets
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from actors.no_calls import nobody_to_call
from actors.signals import end_children, retake_signals
from actors.site import all_sites, require_sites
from pipeline.errors import InputError, RunFailedError
from pipeline.leftovers import swept
from pipeline.logs import FOLDER_VARIABLE
from pipeline.mission.stopping import Stop

#: Ray takes 1 to 3 s to end, on a busy machine more; whatever is left of a run's time, it gets the least
_LEAST_S, _MOST_S = 3.0, 30.0
#: names the folder of this node's certificates for Ray's connections
TLS_VARIABLE = "SEARCHLIGHT_TLS"
#: of each file of Ray's that is kept after a failure
_TAIL_BYTES = 64 * 1024


@contextmanager
def cluster(address: str | None, sites: Iterable[str], stop: Stop | None = None) -> Iterator[None]:
    """Within it Ray is connected.

    stop: a Ray of our own that takes longer to end than it leaves is killed.
    """
    sites, stop = tuple(sites), stop or Stop()
    if address is None:
        with _local(sites, stop):
            yield
        return
    use_tls()
    import ray

    try:
        ray.init(
            address=address,
            log_to_driver=False,
            logging_level=logging.ERROR,
            namespace="searchlight",
            runtime_env={"env_vars": _variables()},
        )
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise InputError(
            "--address", f"{address} ({str(error).splitlines()[0]})", "the address of a running Ray cluster"
        ) from None
    _silence()
    retake_signals()
    try:
        require_sites(sites, ray.cluster_resources(), address)  # type: ignore[no-untyped-call]
        yield
    finally:
        ray.shutdown()


def use_tls() -> None:
    """Speak with a cluster as deployments/ray-node.sh does: encrypted, where this node has its certificates. Raises
    InputError for a folder of certificates that are not there.
    """
    said = os.environ.get(TLS_VARIABLE)
    folder = Path(said or "/etc/searchlight/tls")
    if said == "off" or "RAY_USE_TLS" in os.environ or (said is None and not folder.is_dir()):
        return
    files = {"CA_CERT": "ca.crt", "SERVER_CERT": "node.crt", "SERVER_KEY": "node.key"}
    for name, file in files.items():
        if not (folder / file).is_file():
            expected = "what deployments/certificates.sh makes, or SEARCHLIGHT_TLS=off"
            raise InputError(TLS_VARIABLE, f"no {folder / file}", expected)
        os.environ[f"RAY_TLS_{name}"] = str(folder / file)
    os.environ["RAY_USE_TLS"] = "1"


@contextmanager
def _local(sites: tuple[str, ...], stop: Stop) -> Iterator[None]:
    # Ray otherwise replaces 127.0.0.1 by the machine's outside address, writes a token file into the home
    # folder, and reports usage to its makers.
    os.environ.setdefault("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")
    os.environ.setdefault("RAY_AUTH_MODE", "token")
    os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")

    # Ray's sockets must have short paths
    folder = tempfile.mkdtemp(prefix="searchlight-", dir="/tmp" if os.path.isdir("/tmp") else None)
    try:
        try:
            _init(
                address="local",
                num_cpus=os.cpu_count(),
                resources=all_sites(sites),
                include_dashboard=False,
                log_to_driver=False,
                logging_level=logging.ERROR,
                namespace="searchlight",
                _node_ip_address="127.0.0.1",
                _temp_dir=folder,
                object_store_memory=256 * 1024 * 1024,
            )
        except (RuntimeError, ConnectionError, OSError) as error:
            # on a machine that is busy beyond measure Ray gives up waiting for its own parts
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise RunFailedError(f"Ray did not start ({reason}); try again, or run with --local") from None
        _silence()
        with swept(Path(folder)):
            yield
    finally:
        _shut_down(stop)
        if (stop.reason or "").startswith("failed"):
            _keep_what_ray_says(Path(folder))
        shutil.rmtree(folder, ignore_errors=True)


def _silence() -> None:
    """Ray prints to the terminal who has died, in its own words. We say it in ours; its files keep what it says."""
    with suppress(ImportError, AttributeError):  # of Ray's own rooms: where they change, it prints again
        from ray._private import worker

        worker._worker_logs_enabled = False


def _variables() -> dict[str, str]:
    """What workers on a cluster that others have started must know of us."""
    return {name: os.environ[name] for name in (FOLDER_VARIABLE,) if name in os.environ}


def _init(**arguments: Any) -> None:
    """Start Ray so that a terminal that is closed does not take its processes with it: only we decide their end."""
    import ray

    # what is ignored stays ignored in the processes that are started now
    former = signal.signal(signal.SIGHUP, signal.SIG_IGN) if _is_main_thread() else None
    try:
        with nobody_to_call():
            ray.init(**arguments)
    finally:
        if former is not None:
            signal.signal(signal.SIGHUP, former)
        retake_signals()


def _keep_what_ray_says(folder: Path) -> None:
    """After a failure: the end of what Ray's processes and the actors wrote on standard error, beside their logs."""
    logs = Path(os.environ.get(FOLDER_VARIABLE, os.devnull))
    for path in folder.glob("session_latest/logs/*.err"):
        data = path.read_bytes()[-_TAIL_BYTES:]
        # lines that begin with a colon are for Ray's own reader of logs
        said = any(line.strip() and not line.startswith(b":") for line in data.splitlines())
        if said and logs.is_dir():
            (logs / f"ray-{path.name}").write_bytes(data)


def _shut_down(stop: Stop) -> None:
    import ray

    ending = threading.Thread(target=ray.shutdown, daemon=True)
    ending.start()
    ending.join(max(_LEAST_S, min(stop.left_s, _MOST_S)))
    if ending.is_alive() or stop.reason is not None:
        end_children()


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()

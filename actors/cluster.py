"""Attach to a Ray cluster, or start one on loopback that ends with the run and leaves nothing behind."""

from __future__ import annotations

import logging
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from actors.site import all_sites, require_sites
from pipeline.errors import InputError, RunFailedError


@contextmanager
def cluster(address: str | None, sites: Iterable[str]) -> Iterator[str]:
    """Within it Ray is connected; yields the host on which the driver's channels listen."""
    sites = tuple(sites)
    if address is None:
        with _local(sites) as host:
            yield host
        return
    import ray

    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR, namespace="searchlight")
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise InputError(
            "--address", f"{address} ({str(error).splitlines()[0]})", "the address of a running Ray cluster"
        ) from None
    try:
        require_sites(sites, ray.cluster_resources(), address)  # type: ignore[no-untyped-call]
        yield ray.util.get_node_ip_address()  # type: ignore[no-untyped-call]
    finally:
        ray.shutdown()


@contextmanager
def _local(sites: tuple[str, ...]) -> Iterator[str]:
    # Ray otherwise replaces 127.0.0.1 by the machine's outside address, writes a token file into the home
    # folder, and reports usage to its makers.
    os.environ.setdefault("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")
    os.environ.setdefault("RAY_AUTH_MODE", "token")
    os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    import ray

    # Ray's sockets must have short paths
    folder = tempfile.mkdtemp(prefix="searchlight-", dir="/tmp" if os.path.isdir("/tmp") else None)
    try:
        try:
            ray.init(
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
        yield "127.0.0.1"
    finally:
        ray.shutdown()
        shutil.rmtree(folder, ignore_errors=True)

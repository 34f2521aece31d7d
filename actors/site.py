"""A site is a Ray resource: the node that offers ``site:NAME`` is where the actors of that site run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pipeline.errors import InputError


def resource(site: str) -> str:
    """The resource that a node of the site offers."""
    return f"site:{site}"


def all_sites(sites: Iterable[str]) -> dict[str, float]:
    """Resources of a node that plays every site at once, as a local run's only node does."""
    return {resource(site): 1.0 for site in sites}


def placement(site: str) -> dict[str, float]:
    """What an actor asks for to run at the site; a thousand actors fit."""
    return {resource(site): 0.001}


def require_sites(sites: Iterable[str], cluster: Mapping[str, float], address: str) -> None:
    """Raises InputError for a site that no node of the cluster plays."""
    for site in sites:
        if cluster.get(resource(site), 0.0) <= 0.0:
            start = f"ray start --address=HEAD --resources='{{\"{resource(site)}\": 1}}'"
            raise InputError(
                f"Ray cluster at {address}",
                f"no node with the resource {resource(site)!r}",
                f"one, started with: {start}",
            )


def sites_here(sites: Iterable[str]) -> frozenset[str]:
    """Those that the node of the caller plays: no radio lies between."""
    import ray

    own = ray.get_runtime_context().get_node_id()
    nodes: list[dict[str, Any]] = ray.nodes()  # type: ignore[no-untyped-call]
    offered: Mapping[str, float] = next((n["Resources"] for n in nodes if n["NodeID"] == own), {})
    return frozenset(site for site in sites if offered.get(resource(site), 0.0) > 0.0)


def own_host() -> str:
    """The address of the node that the caller runs on: where its channels listen, and no other interface."""
    import ray

    host: str = ray.util.get_node_ip_address()  # type: ignore[no-untyped-call]
    return host

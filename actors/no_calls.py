"""Ray's own processes call nobody.

Its dashboard process runs even without a dashboard. With usage reports disabled it still asks three cloud providers
where it runs (``metadata.google.internal``, ``169.254.169.254``), and on a cluster tells Ray's makers that reports are
disabled. There is no switch for either (Ray 2.x, usage_stats_head.py); but what it asks, it asks by way of a proxy if
it is told of one, and none is at this one.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager

#: port 1 of loopback, which nobody listens on. In capitals alone: gRPC, which Ray speaks with itself, reads the others
NO_PROXY_THERE = {"HTTP_PROXY": "http://127.0.0.1:1", "HTTPS_PROXY": "http://127.0.0.1:1"}
#: these would lead past it
_PAST_IT = ("http_proxy", "https_proxy", "all_proxy", "ALL_PROXY", "no_proxy", "NO_PROXY")


@contextmanager
def nobody_to_call(environment: MutableMapping[str, str] = os.environ) -> Iterator[None]:
    """Processes that are started within reach nobody by HTTP; afterwards the environment is as it was."""
    names = (*NO_PROXY_THERE, *_PAST_IT)
    before = {name: environment[name] for name in names if name in environment}
    for name in names:
        environment.pop(name, None)
    environment.update(NO_PROXY_THERE)
    try:
        yield
    finally:
        for name in names:
            environment.pop(name, None)
        environment.update(before)

import os
import re
from pathlib import Path

import pytest
import requests

from actors.no_calls import NO_PROXY_THERE, nobody_to_call

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize(
    "before",
    [
        {},
        {"HTTP_PROXY": "http://proxy:3128", "no_proxy": "*"},
        {"https_proxy": "http://p:1", "NO_PROXY": "a.org"},
    ],
)
def test_within_it_requests_reach_nobody_and_afterwards_all_is_as_it_was(
    monkeypatch: pytest.MonkeyPatch, before: dict[str, str]
) -> None:
    for name in ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "NO_PROXY"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.lower(), raising=False)
    for name, value in before.items():
        monkeypatch.setenv(name, value)
    own = dict(os.environ)
    with nobody_to_call():
        for url in ("http://metadata.google.internal/", "http://169.254.169.254/", "https://example.org/"):
            with pytest.raises(requests.exceptions.ProxyError):
                requests.get(url, timeout=2.0)
    assert dict(os.environ) == own


def test_nodes_of_a_cluster_are_started_the_same_way() -> None:
    script = (ROOT / "deployments/ray-node.sh").read_text(encoding="utf-8")
    assert dict(re.findall(r"(HTTPS?_PROXY)=(\S+)", script)) == NO_PROXY_THERE
    assert re.search(r"^unset .*\bhttp_proxy\b.*\bNO_PROXY\b", script, re.MULTILINE)

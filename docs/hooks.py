"""For the site: what is linked outside of docs/ lies in the repository, and is named instead of linked."""

from __future__ import annotations

import re
from typing import Any

_OUTSIDE = re.compile(r"\[([^\]]+)\]\(\.\./([^)#]+)[^)]*\)")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """``[text](../path)`` as ``text (path in the repository)``; a text that is the path already, alone."""
    return _OUTSIDE.sub(_named, markdown)


def _named(link: re.Match[str]) -> str:
    text, path = link.groups()
    return (
        text if text.strip("`").endswith(path.rsplit("/", 1)[-1]) else f"{text} (`{path}` in the repository)"
    )

"""The address of a live stream, whose secrets are shown to nobody."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Annotated
from urllib.parse import parse_qsl, urlsplit, urlunsplit

from pydantic import BeforeValidator

from pipeline.config.base import mismatch

#: scheme -> what it is
VIDEO_SCHEMES = {"rtsp": "RTSP", "rtmp": "RTMP", "udp": "MPEG-TS over UDP", "srt": "MPEG-TS over SRT"}
#: what of a query may be shown; any other value may be a password
_HARMLESS = frozenset(
    [
        "listen",
        "mode",
        "latency",
        "transport",
        "localaddr",
        "buffer_size",
        "fifo_size",
        "pkt_size",
        "ttl",
        "connect_timeout",
    ]
)
_IS_URL = re.compile(r"^[A-Za-z][A-Za-z0-9+.-]*://")
_HIDDEN = "***"


@dataclass(frozen=True)
class StreamUrl:
    """text: as it was written, with its password: only what opens the stream may read it.

    As text (``str``, ``repr``) a password, and whatever in the query might be one, is ``***``.
    """

    text: str = field(repr=False)

    @property
    def scheme(self) -> str:
        """Such as ``rtsp``."""
        return urlsplit(self.text).scheme.lower()

    @property
    def host(self) -> str:
        """Name or address, without brackets; empty where there is none."""
        return urlsplit(self.text).hostname or ""

    @property
    def port(self) -> int | None:
        """None where there is none."""
        return urlsplit(self.text).port

    @property
    def query(self) -> dict[str, str]:
        """What stands behind the question mark."""
        return dict(parse_qsl(urlsplit(self.text).query, keep_blank_values=True))

    @property
    def has_password(self) -> bool:
        """Whether it brings one."""
        return str(self) != self.text

    def without_query(self) -> str:
        """With its password, for who opens it."""
        return urlunsplit(urlsplit(self.text)._replace(query=""))

    def __str__(self) -> str:
        parts = urlsplit(self.text)
        user, at, place = parts.netloc.rpartition("@")
        name, colon, _ = user.partition(":")
        query = re.sub(
            r"([^&=]+)=([^&]+)", lambda m: m[0] if m[1] in _HARMLESS else f"{m[1]}={_HIDDEN}", parts.query
        )
        netloc = f"{name}{colon}{_HIDDEN if colon else ''}{at}{place}"
        return urlunsplit(parts._replace(netloc=netloc, query=query))

    def __repr__(self) -> str:
        return f"StreamUrl({str(self)!r})"


def is_url(given: object) -> bool:
    """Whether a text is an address, not a path."""
    return isinstance(given, str) and _IS_URL.match(given) is not None


def stream_url(text: str, schemes: tuple[str, ...]) -> StreamUrl:
    """Raises a mismatch unless it is a whole address of one of the schemes."""
    scheme = text.partition("://")[0].lower()
    expected = f"a URL that begins with {', '.join(f'{s}://' for s in schemes)}"
    if scheme not in schemes:
        raise mismatch(f"a URL that begins with {scheme}://", expected)
    try:
        url = StreamUrl(text)
        needs_port = scheme in ("udp", "srt")
        port = url.port
        if (needs_port and port is None) or (scheme != "udp" and not url.host):
            raise mismatch(str(url), f"{scheme}://HOST{':PORT' if needs_port else ''}")
    except ValueError:  # what cannot be taken apart may hold a password anywhere
        raise mismatch(f"a {scheme}:// URL that cannot be read", f"{scheme}://HOST:PORT/PATH") from None
    return url


def _given(given: object) -> object:
    return stream_url(given, tuple(VIDEO_SCHEMES)) if isinstance(given, str) else given


#: a field that holds one
LiveUrl = Annotated[StreamUrl, BeforeValidator(_given)]

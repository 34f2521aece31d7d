"""The length prefix bounds what a peer can make us hold."""

import pytest

from pipeline.errors import ProtocolError
from pipeline.link.framing import FrameReader, frame
from pipeline.messages import MAX_MESSAGE_BYTES


def test_the_prefix_is_the_length_big_endian() -> None:
    assert frame(b"abc") == b"\x00\x00\x00\x03abc"


def test_a_length_over_the_limit_is_refused_before_its_bytes_come() -> None:
    with pytest.raises(ProtocolError, match=str(MAX_MESSAGE_BYTES + 1)):
        FrameReader().feed((MAX_MESSAGE_BYTES + 1).to_bytes(4, "big"))


def test_a_message_over_the_limit_is_not_framed() -> None:
    with pytest.raises(ProtocolError, match="at most"):
        frame(bytes(MAX_MESSAGE_BYTES + 1))

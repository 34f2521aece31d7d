"""A record is read once, in its turn, and whole, or not at all."""

from __future__ import annotations

import pytest

from pipeline.errors import ProtocolError
from pipeline.link.records import OVERHEAD_BYTES, record_bytes
from pipeline.messages import MAX_MESSAGE_BYTES
from tests.channel_ends import one_way


def test_a_record_is_20_bytes_longer_than_its_message_and_does_not_show_it() -> None:
    writer, _ = one_way()
    message = b"the marker that nobody may see"
    record = writer.seal(message)
    assert len(record) == record_bytes(message) == len(message) + OVERHEAD_BYTES == len(message) + 20
    assert message not in record
    assert writer.seal(message) != record


def test_a_length_over_the_limit_is_refused_before_its_bytes_come() -> None:
    for length in (MAX_MESSAGE_BYTES + 17, 2**32 - 1, 15, 0):
        _, reader = one_way()
        with pytest.raises(ProtocolError, match=str(length)) as refused:
            reader.feed(length.to_bytes(4, "big"))
        assert refused.value.reason == "bad_length"


def test_a_message_over_the_limit_is_not_sealed() -> None:
    with pytest.raises(ProtocolError, match="at most"):
        record_bytes(bytes(MAX_MESSAGE_BYTES + 1))


def test_a_heartbeat_is_heard_and_is_no_message() -> None:
    writer, reader = one_way()
    assert reader.feed(writer.seal(b"")) == []
    assert reader.heard == 1


def _stream(*order: int) -> bytes:
    writer, _ = one_way()
    records = [writer.seal(f"message {index}".encode()) for index in range(4)]
    return b"".join(records[index] for index in order)


@pytest.mark.parametrize("order", [(0, 0), (1,), (0, 2), (0, 1, 0), (0, 1, 3, 2), (0, 1, 1)])
def test_sent_twice_left_out_or_exchanged(order: tuple[int, ...]) -> None:
    _, reader = one_way()
    with pytest.raises(ProtocolError) as refused:
        reader.feed(_stream(*order))
    assert refused.value.reason == "not_authentic"


@pytest.mark.parametrize("at", [4, 5, 12, -1])
@pytest.mark.parametrize("flip", [1, 0x80])
def test_a_changed_byte(at: int, flip: int) -> None:
    data = bytearray(_stream(0))
    data[at] ^= flip
    with pytest.raises(ProtocolError):
        one_way()[1].feed(bytes(data))


def test_a_record_of_another_connection() -> None:
    _, reader = one_way(bytes(range(32)))
    with pytest.raises(ProtocolError):
        reader.feed(_stream(0))


def test_an_end_within_a_record_is_seen() -> None:
    _, reader = one_way()
    assert not reader.is_cut
    reader.feed(_stream(0, 1)[:-1])
    assert reader.is_cut


def test_both_ends_change_the_key_at_the_same_message() -> None:
    (writer, reader), (once, _) = one_way(rekey_bytes=100), one_way()
    for index in range(50):
        message = bytes([index]) * 9
        record = writer.seal(message)
        assert reader.feed(record) == [message]
        assert (record == once.seal(message)) == (index < 12), "the twelfth message fills the first key"

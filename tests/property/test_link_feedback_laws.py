"""What a receiver says back survives any cut of the stream, and no other bytes are taken for it."""

from __future__ import annotations

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import ProtocolError
from pipeline.link.feedback import Feedback, FeedbackReader, Read, Restart, pack_feedback

names = st.text(max_size=40)
reads = st.builds(Read, st.integers(0, 2**63), st.integers(0, 10**15).map(lambda us: us * 1e-6))
records = st.one_of(reads, st.builds(Restart, names, names))


@given(st.lists(records, max_size=8), st.lists(st.integers(1, 30), min_size=1))
def test_records_come_back_in_order_however_the_stream_is_cut(said: list[Feedback], cuts: list[int]) -> None:
    stream, reader, heard = b"".join(map(pack_feedback, said)), FeedbackReader(), []
    position = turn = 0
    while position < len(stream):
        end = position + cuts[turn % len(cuts)]
        heard += reader.feed(stream[position:end])
        position, turn = end, turn + 1
    assert len(heard) == len(said)
    for one, other in zip(heard, said, strict=True):
        if isinstance(other, Read):
            assert isinstance(one, Read)
            assert one.total_bytes == other.total_bytes
            assert one.at_s == pytest.approx(other.at_s, abs=1e-6)
        else:
            assert one == other


@given(st.binary(max_size=200))
def test_any_bytes_give_records_or_a_protocol_error(data: bytes) -> None:
    with suppress(ProtocolError):
        FeedbackReader().feed(data)


@given(st.integers(3, 255), st.binary(max_size=30))
def test_a_record_of_another_kind_is_refused(kind: int, data: bytes) -> None:
    with pytest.raises(ProtocolError, match=f"kind {kind}"):
        FeedbackReader().feed(bytes([kind]) + data)

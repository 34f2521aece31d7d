"""Framing survives any cutting of the stream."""

from hypothesis import given
from hypothesis import strategies as st

from pipeline.link.framing import FrameReader, frame


@given(st.lists(st.binary(max_size=50), max_size=10), st.lists(st.integers(1, 40), min_size=1))
def test_messages_come_back_whole_and_in_order_however_the_stream_is_cut(
    messages: list[bytes], cuts: list[int]
) -> None:
    stream, reader, received = b"".join(frame(message) for message in messages), FrameReader(), []
    position = turn = 0
    while position < len(stream):
        end = position + cuts[turn % len(cuts)]
        received += reader.feed(stream[position:end])
        position, turn = end, turn + 1
    assert received == [message for message in messages if message]  # an empty one is a heartbeat

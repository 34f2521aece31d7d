"""Records survive any cutting of the stream, and nothing else is taken for one."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import ProtocolError
from pipeline.link.feedback import FeedbackReader
from pipeline.link.handshake import HELLO, Greeting
from pipeline.link.keys import KeyPair
from pipeline.link.noise import FIRST_BYTES
from pipeline.messages import Dropped, pack, unpack
from tests.channel_ends import one_way

KEYS = KeyPair()


@given(st.lists(st.binary(max_size=50), max_size=10), st.lists(st.integers(1, 40), min_size=1))
def test_messages_come_back_whole_and_in_order_however_the_stream_is_cut(
    messages: list[bytes], cuts: list[int]
) -> None:
    writer, reader = one_way()
    stream, received = b"".join(writer.seal(message) for message in messages), []
    position = turn = 0
    while position < len(stream):
        end = position + cuts[turn % len(cuts)]
        received += reader.feed(stream[position:end])
        position, turn = end, turn + 1
    assert received == [message for message in messages if message]  # an empty one is a heartbeat


def _mutated(rng: random.Random, data: bytes) -> bytes:
    """Bytes that were changed, taken out, put in, or cut off, at one to four places."""
    mangled = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(mangled) + 1)
        match rng.randrange(4):
            case 0 if at < len(mangled):
                mangled[at] ^= 1 << rng.randrange(8)
            case 1:
                del mangled[at : at + rng.randint(1, 8)]
            case 2:
                mangled[at:at] = rng.randbytes(rng.randint(1, 8))
            case _:
                del mangled[at:]
    return bytes(mangled)


def _fuzz_records(rng: random.Random) -> None:
    """No prefix of what is read is anything but what was sent."""
    writer, reader = one_way()
    sent = [rng.randbytes(rng.randint(1, 40)) for _ in range(3)]
    read: list[bytes] = []
    try:
        for piece in (_mutated(rng, b"".join(map(writer.seal, sent))),):
            read += reader.feed(piece)
    except ProtocolError:
        return
    assert read == sent[: len(read)]


def _fuzz_greeting(rng: random.Random) -> None:
    """Nobody comes in who does not hold a key, whatever it says."""
    greeting = Greeting(KEYS, {KEYS.public: "a peer"}.get)
    said = rng.choice([HELLO, HELLO, b"", b"SLNK"]) + rng.randbytes(rng.randint(0, FIRST_BYTES + 20))
    try:
        while said and greeting.wanted_bytes:
            wanted = greeting.wanted_bytes
            assert not greeting.take(said[:wanted]), "a stranger is answered nothing"
            said = said[wanted:]
    except ProtocolError:
        return
    assert greeting.session is None


def _fuzz_messages(rng: random.Random) -> None:
    data = pack(Dropped("drone-1", "d", rng.randrange(99), rng.randrange(10**18), "late", 1, 2))
    try:
        unpack(_mutated(rng, data))
    except ProtocolError:
        return


def _fuzz_feedback(rng: random.Random) -> None:
    try:
        FeedbackReader().feed(rng.choice([b"\x01", b"\x02", b""]) + rng.randbytes(rng.randint(0, 60)))
    except ProtocolError:
        return


#: how often of 100; a handshake costs three key agreements
_FUZZERS = ((_fuzz_records, 45), (_fuzz_messages, 35), (_fuzz_feedback, 10), (_fuzz_greeting, 10))


_MANY = pytest.param(1_000_000, marks=[pytest.mark.slow, pytest.mark.timeout(3600)])


@pytest.mark.parametrize("count", [10_000, _MANY])
def test_fuzzed_input_gives_what_was_sent_or_an_error_and_lets_nobody_in(count: int) -> None:
    rng = random.Random(14)
    for fuzz, share in _FUZZERS:
        for _ in range(count * share // 100):
            fuzz(rng)

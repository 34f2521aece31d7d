from contextlib import suppress
from typing import Any

import msgpack
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

from pipeline.errors import ProtocolError
from pipeline.messages import CameraPose, Detections, Hops, pack, unpack

FLOATS = st.floats(allow_nan=True, allow_infinity=True)
INT64 = st.integers(-(2**63), 2**63 - 1)
PLAIN: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | INT64 | FLOATS | st.text(max_size=5) | st.binary(max_size=99),
    lambda inner: st.lists(inner, max_size=12) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
)
#: fields that are nearly those of a message
NEARLY = st.tuples(st.integers(-1, 5), st.lists(PLAIN, max_size=18)).map(lambda v: [v[0], *v[1]])


@st.composite
def detections(draw: st.DrawFn) -> Detections:
    count = draw(st.integers(0, 4))
    array = st_numpy.arrays
    return Detections(
        draw(st.text(max_size=8)),
        draw(st.text(max_size=8)),
        draw(st.integers(0, 2**48)),
        draw(st.integers(0, 2**63 - 1)),
        CameraPose(draw(array(np.float64, 3)), draw(array(np.float64, (3, 3)))),
        draw(array(np.float64, (count, 4))),
        draw(array(np.float64, count)),
        draw(array(np.int64, count)),
        Hops(*(draw(st.floats(0.0, 1e9)) for _ in range(6)), draw(st.integers(0, 2**63 - 1))),
    )


@given(detections())
def test_the_wire_form_of_what_came_over_the_wire_is_the_same_bytes(sent: Detections) -> None:
    assert pack(unpack(pack(sent))) == pack(sent)


@given(st.binary(max_size=200))
def test_any_bytes_give_a_message_or_a_protocol_error(data: bytes) -> None:
    with suppress(ProtocolError):
        unpack(data)


@given(PLAIN)
def test_any_plain_value_on_the_wire_gives_a_message_or_a_protocol_error(value: Any) -> None:
    with suppress(ProtocolError):
        unpack(msgpack.packb(value))


@given(NEARLY)
def test_any_fields_of_any_message_give_it_or_a_protocol_error(value: list[Any]) -> None:
    with suppress(ProtocolError):
        unpack(msgpack.packb(value))


@given(detections(), st.data())
def test_a_cut_message_is_a_protocol_error(sent: Detections, data: st.DataObject) -> None:
    whole = pack(sent)
    try:
        unpack(whole[: data.draw(st.integers(0, len(whole) - 1))])
    except ProtocolError:
        return
    raise AssertionError("a cut message was taken")

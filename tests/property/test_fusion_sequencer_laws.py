"""Whatever the way here, results leave in one order."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.fusion.sequencer import Sequencer
from pipeline.messages import CameraPose, Detections, Dropped, EndOfStream

POSE = CameraPose(np.zeros(3), np.eye(3))
SUBSTREAMS = [("a", "d"), ("a", "e"), ("b", "d")]


def _result(substream, time_ns):
    empty = np.zeros((0, 4)), np.zeros(0), np.zeros(0, dtype=np.int64)
    return Detections(*substream, 0, time_ns, POSE, *empty)


times = st.lists(st.integers(0, 30), unique=True, max_size=8).map(sorted)


@st.composite
def arrivals(draw):
    """What was sent, and one way in which it may arrive: each substream in order, parts of it again."""
    queues, sent = [], []
    for substream in SUBSTREAMS:
        messages = []
        for t in draw(times):
            lost = draw(st.booleans()) and draw(st.booleans())
            messages.append(Dropped(*substream, 0, t, "test") if lost else _result(substream, t))
        sent += [m.order for m in messages if isinstance(m, Detections)]
        if messages and draw(st.booleans()):  # a restart: the substream goes back and comes again
            back = draw(st.integers(0, len(messages) - 1))
            at = draw(st.integers(back, len(messages)))
            messages = messages[:at] + messages[back:]
        queues.append([*messages, EndOfStream(*substream)])
    arrived = []
    while any(queues):
        queue = draw(st.sampled_from([q for q in queues if q]))
        arrived.append(queue.pop(0))
    return sorted(sent), arrived


@given(arrivals())
def test_any_interleaving_with_repetitions_gives_the_same_sequence(case):
    sent, arrived = case
    sequencer = Sequencer(SUBSTREAMS, None)
    released = [r.order for message in arrived for r in sequencer.push(message)]
    assert released == sent
    assert sequencer.finish() == []


@given(arrivals(), st.integers(1, 40))
def test_with_a_lateness_every_result_is_released_once_and_in_order_or_counted(case, lateness_ns):
    sent, arrived = case
    sequencer = Sequencer(SUBSTREAMS, lateness_ns)
    released = [r.order for message in arrived for r in sequencer.push(message)]
    released += [r.order for r in sequencer.finish()]
    results = sum(isinstance(message, Detections) for message in arrived)
    assert sorted(released) == sent
    assert len(released) + sequencer.refused.total() == results
    out_of_place = sum(order < max(released[:i]) for i, order in enumerate(released) if i)
    assert out_of_place == sequencer.late.total()

from dataclasses import replace

import numpy as np

from pipeline.fusion.sequencer import Sequencer
from pipeline.messages import CameraPose, Detections, Dropped, EndOfStream

POSE = CameraPose(np.zeros(3), np.eye(3))


def _result(stream, time_ns, detector="d"):
    empty = np.zeros((0, 4)), np.zeros(0), np.zeros(0, dtype=np.int64)
    return Detections(stream, detector, 0, time_ns, POSE, *empty)


def _orders(results):
    return [(r.time_ns, r.stream) for r in results]


def test_a_result_waits_for_every_open_substream():
    sequencer = Sequencer({("a", "d"), ("b", "d")}, None)
    assert sequencer.push(_result("a", 10)) == []
    assert sequencer.push(_result("a", 20)) == []
    assert _orders(sequencer.push(_result("b", 15))) == [(10, "a"), (15, "b")]


def test_equal_times_come_in_order_of_stream():
    sequencer = Sequencer({("a", "d"), ("b", "d")}, None)
    sequencer.push(_result("b", 10))
    assert _orders(sequencer.push(_result("a", 10))) == [(10, "a"), (10, "b")]


def test_a_dropped_frame_lets_the_others_pass():
    sequencer = Sequencer({("a", "d"), ("b", "d")}, None)
    sequencer.push(_result("a", 10))
    assert _orders(sequencer.push(Dropped("b", "d", 0, 12, "queue full"))) == [(10, "a")]


def test_an_ended_substream_is_waited_for_no_longer():
    sequencer = Sequencer({("a", "d"), ("b", "d")}, None)
    sequencer.push(_result("a", 10))
    assert _orders(sequencer.push(EndOfStream("b", "d"))) == [(10, "a")]


def test_a_silent_substream_is_waited_for_as_long_as_the_lateness():
    sequencer = Sequencer({("a", "d"), ("b", "d")}, 100)
    assert sequencer.push(_result("a", 10)) == []
    assert sequencer.push(_result("a", 109)) == []
    assert _orders(sequencer.push(_result("a", 110))) == [(10, "a")]


def test_a_late_result_is_released_at_once_and_counted():
    sequencer = Sequencer({("a", "d"), ("b", "d")}, 100)
    sequencer.push(_result("a", 10))
    sequencer.push(_result("a", 110))
    assert _orders(sequencer.push(_result("b", 9))) == [(9, "b")]
    assert sequencer.late == {("b", "d"): 1}
    assert sequencer.push(_result("b", 9)) == []
    assert sequencer.refused == {("b", "d", "duplicate"): 1}
    assert _orders(sequencer.finish()) == [(110, "a")]


def test_a_result_from_before_its_streams_start_is_dropped_and_counted():
    sequencer = Sequencer({("a", "d"), ("b", "d")}, None, {"a": 10, "b": 0})
    assert sequencer.push(_result("a", 9)) == []
    assert sequencer.refused == {("a", "d", "before the start"): 1}
    assert _orders(sequencer.push(_result("b", 9))) == []
    assert _orders(sequencer.push(_result("a", 10))) == [(9, "b")]


def test_results_of_one_substream_are_put_right_within_the_lateness():
    sequencer = Sequencer({("a", "d")}, 100)
    released = [r for t in (40, 10, 30, 20, 130) for r in sequencer.push(_result("a", t))]
    assert _orders(released + sequencer.finish()) == [(t, "a") for t in (10, 20, 30, 40, 130)]
    assert not sequencer.late


def test_a_result_that_comes_twice_counts_once():
    sequencer = Sequencer({("a", "d"), ("b", "d")}, None)
    sequencer.push(_result("a", 10))
    sequencer.push(_result("a", 10))
    assert _orders(sequencer.push(_result("b", 10))) == [(10, "a"), (10, "b")]
    assert sequencer.push(_result("a", 10)) == []
    assert sequencer.refused == {("a", "d", "duplicate"): 2}
    assert sequencer.finish() == []


def test_a_result_of_an_unknown_substream_is_dropped_and_counted():
    sequencer = Sequencer({("a", "d")}, None)
    assert sequencer.push(_result("a", 10, detector="x")) == []
    assert sequencer.refused == {("a", "x", "unknown substream"): 1}


def test_finish_releases_the_rest_in_order():
    sequencer = Sequencer({("a", "d"), ("b", "d")}, None)
    sequencer.push(_result("a", 20))
    sequencer.push(_result("a", 30))
    assert _orders(sequencer.finish()) == [(20, "a"), (30, "a")]


def _at_epoch(result, epoch):
    return replace(result, epoch=epoch)


def test_a_substream_that_is_opened_again_is_waited_for_anew():
    sequencer = Sequencer({("a", "d"), ("b", "d")}, None)
    sequencer.push(EndOfStream("a", "d"))
    sequencer.open_again("a", "d", 3)
    assert sequencer.push(_result("b", 10)) == []
    assert _orders(sequencer.push(_at_epoch(_result("a", 12), 3))) == [(10, "b")]


def test_results_of_the_epoch_before_may_come_after_it_was_opened_again():
    sequencer = Sequencer({("a", "d")}, None)
    sequencer.open_again("a", "d", 3)
    assert sequencer.push(_at_epoch(_result("a", 20), 3)) == []
    assert _orders(sequencer.push(_result("a", 10))) == [(10, "a")]
    assert _orders(sequencer.push(EndOfStream("a", "d"))) == [(20, "a")]


def test_the_same_frame_of_two_epochs_counts_once():
    sequencer = Sequencer({("a", "d")}, None)
    sequencer.open_again("a", "d", 3)
    sequencer.push(_result("a", 10))
    sequencer.push(_at_epoch(_result("a", 10), 3))
    assert sequencer.refused == {("a", "d", "duplicate"): 1}


def test_a_closed_substream_is_not_waited_for_and_nothing_more_is_taken_of_it():
    sequencer = Sequencer({("a", "d"), ("b", "d")}, None)
    sequencer.push(_result("b", 10))
    assert _orders(sequencer.close("a", "d", 0)) == [(10, "b")]
    assert sequencer.push(_result("a", 20)) == []
    assert sequencer.refused == {("a", "d", "closed"): 1}
    sequencer.open_again("a", "d", 0)
    assert ("a", "d", 0) not in sequencer.open


def test_an_epoch_that_was_never_opened_is_unknown():
    sequencer = Sequencer({("a", "d")}, None)
    assert sequencer.push(_at_epoch(_result("a", 10), 1)) == []
    assert sequencer.refused == {("a", "d", "unknown substream"): 1}


def test_a_restored_sequencer_knows_what_is_open_what_is_closed_and_what_has_said_nothing_yet():
    sequencer = Sequencer({("a", "d"), ("b", "d")}, None)
    sequencer.open_again("a", "d", 3)
    sequencer.close("b", "d", 0)
    again = Sequencer({("a", "d"), ("b", "d")}, None)
    again.restore(sequencer.state)
    assert again.state == sequencer.state
    assert again.open == {("a", "d", 0), ("a", "d", 3)}
    assert again.push(_result("b", 10)) == []
    assert again.refused == {("b", "d", "closed"): 1}

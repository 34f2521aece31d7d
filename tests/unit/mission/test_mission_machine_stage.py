"""What a machine holds, as it is ordered."""

from __future__ import annotations

import queue
import threading
from dataclasses import replace

import numpy as np
import pytest

from pipeline.allocation.plan import Assignment
from pipeline.clock import Clock
from pipeline.errors import InputError
from pipeline.link.codec import Encoder
from pipeline.messages import CameraPose, Detections, Dropped, EndOfStream, Packet
from pipeline.mission.controller.orders import Run
from pipeline.mission.controller.substreams import Opened, Substream
from pipeline.mission.durable_reducer import Acknowledgement
from pipeline.mission.stages.inbox import InboxParams
from pipeline.mission.stages.kept_results import KeptParams, KeptResults
from pipeline.mission.stages.machine import MachineStage

POSE = CameraPose(np.zeros(3), np.eye(3))
NOTHING = np.zeros((0, 4)), np.zeros(0), np.zeros(0, dtype=np.int64)


class Network:
    """Finds nothing; fails at the picture of a number, counted from the first one after the black one."""

    def __init__(self, fails_at: int | None = None) -> None:
        self.looks, self._fails_at, self.busy = -1, fails_at, False

    def detect(self, image):
        assert not self.busy, "two pictures at a time"
        self.busy = True
        self.looks += 1
        if self.looks == self._fails_at:
            raise RuntimeError("out of memory")
        self.busy = False
        return NOTHING


class Machine:
    """A stage whose answers come into a queue, and whose networks can be made to wait or to fail."""

    def __init__(self, fails_at: int | None = None, clock: Clock | None = None) -> None:
        self.answers: queue.Queue = queue.Queue()
        self.loaded: list[Assignment] = []
        self.networks: list[Network] = []
        self.may_load = threading.Event()
        self.may_load.set()
        self.fails_at = fails_at
        self.stage = MachineStage(
            "m",
            "h264",
            self.load,
            lambda message, urgent: self.answers.put(message),
            lambda stream, detector: None,
            InboxParams(),
            clock or Clock(),
            drops=True,
        )

    def load(self, assignment: Assignment) -> Network:
        assert self.may_load.wait(20.0)
        self.loaded.append(assignment)
        if assignment.pool_detector == "broken":
            raise InputError("broken.onnx", "no model", "a model")
        self.networks.append(Network(self.fails_at))
        return self.networks[-1]

    def run(self, *substreams: Opened, number: int = 0, wait: bool = True) -> tuple[Substream, ...]:
        dropped = self.stage.run(Run("m", substreams, 0, number))
        if wait:
            self.stage.wait_ready()
        return dropped

    def answer(self):
        return self.answers.get(timeout=20.0)


def opened(epoch: int = 0, stream: str = "v", detector: str = "m:d", bitrate_bps: float = 1e6) -> Opened:
    pool = detector.partition(":")[2]
    return Opened(epoch, Assignment(stream, detector, pool, "m", "s", 1, 0, bitrate_bps))


def packets(of: Opened, count: int) -> list[Packet]:
    encoder = Encoder("h264", 64, 48, 10.0, 1e5, 100)
    image, key = np.zeros((48, 64, 3), np.uint8), of.key
    made = []
    for k in range(count):
        e = encoder.encode(image, k)
        made.append(
            Packet(
                key.stream,
                key.detector,
                k,
                k * 10,
                k,
                1,
                10,
                e.keyframe,
                POSE,
                e.data,
                epoch=key.epoch,
                sequence=k,
            )
        )
    return made


def test_a_substream_is_ready_once_its_network_is_loaded_and_looked_at_a_black_picture() -> None:
    machine = Machine()
    machine.may_load.clear()
    machine.run(opened(), wait=False)
    assert machine.stage.report().running == {opened().key}
    assert not machine.stage.report().ready
    machine.may_load.set()
    machine.stage.wait_ready()
    assert machine.stage.report(3).ready == {opened().key}
    assert machine.stage.report(3).incarnation == 3
    assert machine.networks[0].looks == 0


def test_every_packet_of_a_held_substream_is_answered_in_order_and_then_its_end() -> None:
    machine = Machine()
    machine.run(opened())
    for packet in packets(opened(), 3):
        machine.stage.put(packet)
    machine.stage.put(EndOfStream("v", "m:d", 0, 3))
    answers = [machine.answer() for _ in range(4)]
    assert [a.sequence for a in answers] == [0, 1, 2, 3]
    assert isinstance(answers[-1], EndOfStream)
    assert all(isinstance(a, Detections) for a in answers[:-1])


@pytest.mark.parametrize(("waited_s", "looked_at"), [(0.9, 3), (1.1, 0)])
def test_packets_that_waited_too_long_are_decoded_but_not_looked_at(waited_s: float, looked_at: int) -> None:
    """And the next one, which needs them for its picture and did not wait, is looked at."""
    now_s = [0.0]
    machine = Machine(clock=Clock(lambda: now_s[0], utc_ns=lambda: 0))
    machine.may_load.clear()
    machine.run(opened(), wait=False)
    *waiting, last = packets(opened(), 4)
    for packet in waiting:
        machine.stage.put(packet)
    now_s[0] = waited_s
    machine.may_load.set()
    answers = [machine.answer() for _ in waiting]
    machine.stage.put(last)
    assert [isinstance(a, Detections) for a in answers] == [looked_at == 3] * 3
    assert all(isinstance(a, Detections) or a.reason == "machine_busy" for a in answers)
    assert isinstance(machine.answer(), Detections)
    assert machine.networks[0].looks == looked_at + 1


def test_packets_of_a_substream_that_is_not_held_are_nobodys() -> None:
    machine = Machine()
    machine.run(opened(1))
    machine.stage.put(packets(opened(0), 1)[0])
    machine.stage.put(packets(opened(1), 1)[0])
    assert machine.answer().epoch == 1
    assert machine.answers.empty()


def test_two_epochs_of_a_stream_share_the_network_and_have_decoders_of_their_own() -> None:
    machine = Machine()
    machine.run(opened(0))
    machine.run(opened(0), opened(1), number=1)
    assert len(machine.loaded) == 1
    old, new = packets(opened(0), 2), packets(opened(1), 2)
    for packet in (old[0], new[0], old[1], new[1]):
        machine.stage.put(packet)
    answers = [machine.answer() for _ in range(4)]
    assert sorted((a.epoch, a.sequence) for a in answers) == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert not any(isinstance(a, Dropped) for a in answers)


def test_another_bitrate_is_another_calibration_so_it_is_loaded_anew() -> None:
    machine = Machine()
    machine.run(opened(0))
    machine.run(opened(1, bitrate_bps=2e6), number=1)
    assert [a.bitrate_bps for a in machine.loaded] == [1e6, 2e6]


def test_what_is_not_ordered_any_more_is_dropped() -> None:
    machine = Machine()
    machine.run(opened(0), opened(0, "w"))
    assert machine.run(opened(0, "w"), number=1) == (opened(0).key,)
    assert machine.stage.report().running == {opened(0, "w").key}
    machine.stage.put(packets(opened(0), 1)[0])
    machine.stage.put(packets(opened(0, "w"), 1)[0])
    assert machine.answer().stream == "w"


def test_an_older_order_changes_nothing() -> None:
    machine = Machine()
    machine.run(opened(1), number=5)
    machine.run(opened(0), number=4)
    assert machine.stage.report().running == {opened(1).key}


def test_a_network_that_fails_takes_its_own_substreams_with_it_and_no_others() -> None:
    machine = Machine(fails_at=2)
    machine.run(opened(0), opened(0, "w"))
    for packet in packets(opened(0), 2):
        machine.stage.put(packet)
    assert machine.answer().sequence == 0
    deadline = threading.Event()
    for _ in range(200):
        if machine.stage.report().failed:
            break
        deadline.wait(0.05)
    (failed,) = machine.stage.report().failed
    assert failed.substream == opened(0).key
    assert "out of memory" in failed.reason
    machine.stage.put(packets(opened(0, "w"), 1)[0])
    assert machine.answer().stream == "w"


def test_a_failed_substream_is_not_brought_back_by_the_order_that_had_it() -> None:
    machine = Machine()
    broken = opened(0, detector="m:broken")
    with pytest.raises(InputError, match=r"broken\.onnx"):
        machine.run(broken)
    machine.run(broken, number=1, wait=False)
    assert machine.stage.report().running == frozenset()
    machine.run(replace(opened(1), epoch=1), number=2, wait=False)
    assert machine.stage.report().running == {opened(1).key}


def test_results_are_kept_until_they_are_acknowledged_and_come_again_in_their_order() -> None:
    kept = KeptResults()
    results = [Dropped("v", "d", k, k, "undecodable", 1, k) for k in range(5)]
    for result in results:
        kept.keep(result)
    kept.acknowledge([Acknowledgement("v", "d", 1, 4, ((1, 2),)), Acknowledgement("v", "d", 0, 9)])
    assert kept.again() == [results[1], results[4]]
    kept.keep(results[1])
    assert len(kept) == 2, "the same result is kept once"
    kept.forget("v", "d", 1)
    assert kept.again() == []


def test_beyond_their_number_the_oldest_results_are_given_up_and_counted() -> None:
    kept = KeptResults(KeptParams(results=3))
    for k in range(5):
        kept.keep(Dropped("v", "d", k, k, "undecodable", 0, k))
    assert [r.sequence for r in kept.again()] == [2, 3, 4]
    assert kept.given_up == 2


def test_a_result_says_how_long_its_packet_waited_and_when_it_was_made() -> None:
    class Slow:
        now_s = 100.0

    clock = Clock(monotonic_s=lambda: Slow.now_s, utc_ns=lambda: round(Slow.now_s * 1e9))
    machine = Machine(clock=clock)
    of = opened()
    machine.run(of)
    machine.networks[0].detect = lambda image: setattr(Slow, "now_s", Slow.now_s + 0.25) or NOTHING
    with machine.stage._held[of.key].inbox._changed:  # both are there before the first one is looked at
        for packet in packets(of, 2):
            machine.stage.put(packet)
    first, second = machine.answer(), machine.answer()
    assert (first.hops.wait_s, second.hops.wait_s) == (0.0, 0.25)
    assert (first.hops.answered_ns, second.hops.answered_ns) == (100_250_000_000, 100_500_000_000)

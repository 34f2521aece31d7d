"""The supervisor never waits for the scheduler; a silent one is replaced, and nothing that it was told is lost."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from actors import hosted_controller
from actors.hosted_controller import HostedController
from actors.scheduler import Heard
from pipeline.errors import RunFailedError
from pipeline.mission.controller.events import Elapsed, Gone

LOST, OTHER = Gone("machine:m", 0, "died"), Gone("source:v", 0, "died")
RECORD = SimpleNamespace(state="state", log=["logged"])
ANSWER = Heard((), all_planned=True)


class Fake:
    """A scheduler's handle; a call's reference is the call itself."""

    def __init__(self) -> None:
        self.calls: list[tuple] = []

    def __getattr__(self, name: str):
        def remote(*arguments: object) -> tuple:
            self.calls.append((name, *arguments))
            return self.calls[-1]

        return SimpleNamespace(remote=remote)


@pytest.fixture
def made(monkeypatch):
    """The schedulers that were started; killed: those that were ended; answers: what their calls give."""
    made = SimpleNamespace(schedulers=[], killed=[], answers={"hear": ANSWER, "begin": None})

    def get(ref, who, limit_s=None):
        answer = made.answers[ref[0]]
        if isinstance(answer, Exception):
            raise answer
        return answer

    monkeypatch.setattr(hosted_controller, "get", get)
    monkeypatch.setattr(hosted_controller, "kill", made.killed.append)

    def new() -> Fake:
        made.schedulers.append(Fake())
        return made.schedulers[-1]

    made.controller = HostedController(new, silence_s=1.5, boot_s=30.0, poll_s=0.25)
    made.controller.begin("plan", RECORD, 10.0)
    return made


def _up(made) -> Fake:
    assert made.controller.heard(True, 10.1) == (None, None)
    return made.schedulers[-1]


def test_it_begins_where_the_record_is_and_is_asked_nothing_until_it_has(made) -> None:
    made.controller.tell([LOST], 10.05)
    assert made.schedulers[0].calls == [("begin", "plan", "state", ("logged",))]
    scheduler = _up(made)
    made.controller.tell([OTHER], 10.2)
    assert scheduler.calls[1:] == [("hear", (LOST, OTHER), 10.2)]


def test_it_is_asked_with_each_event_and_without_one_four_times_a_second(made) -> None:
    scheduler = _up(made)
    for now_s in (10.3, 10.35, 10.4, 10.45, 10.6, 10.65):
        made.controller.tell([LOST] if now_s == 10.4 else [], now_s)
        made.controller.heard(True, now_s)
    assert scheduler.calls[1:] == [("hear", (), 10.3), ("hear", (LOST,), 10.4), ("hear", (), 10.65)]


def test_while_it_is_silent_nobody_waits_and_after_a_while_the_next_one_is_told_the_same_again(made) -> None:
    first = _up(made)
    made.controller.tell([LOST], 11.0)
    assert made.controller.heard(False, 12.4) == (None, None)
    made.controller.tell([OTHER], 12.4)
    answer, say = made.controller.heard(False, 12.6)
    assert (answer, say.what, say.subject) == (None, "lost", "scheduler")
    assert say.detail == "the scheduler did not answer within 1.5 s"
    assert made.killed == [first]
    second = made.schedulers[1]
    assert second.calls == [("begin", "plan", "state", ("logged",))]
    assert made.controller.heard(False, 40.0) == (None, None)  # a process takes its time to start
    assert made.controller.heard(True, 41.0) == (None, None)
    made.controller.tell([Elapsed()], 41.0)
    assert second.calls[1:] == [("hear", (LOST, OTHER, Elapsed()), 41.0)]
    assert made.controller.heard(True, 41.1) == (ANSWER, None)


@pytest.mark.parametrize("call", ["hear", "begin"])
def test_one_that_dies_is_replaced_at_once(made, call: str) -> None:
    made.answers[call] = RunFailedError("the scheduler died")
    made.controller.heard(call == "begin", 10.1)
    if call == "hear":
        made.controller.heard(True, 10.1)
        made.controller.tell([LOST], 10.2)
        _, say = made.controller.heard(True, 10.3)
        assert say.detail == "the scheduler died"
    assert len(made.schedulers) == 2


def test_one_that_never_begins_is_replaced(made) -> None:
    assert made.controller.heard(False, 39.0) == (None, None)
    _, say = made.controller.heard(False, 41.0)
    assert say.detail == "the scheduler did not answer within 30 s"
    assert len(made.schedulers) == 2

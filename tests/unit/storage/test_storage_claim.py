"""A run directory has one writer at a time, and a writer that is known to be able to write."""

import sys
from pathlib import Path
from types import FrameType

import pytest

from pipeline.errors import InputError, StoppedError
from pipeline.storage import claim
from pipeline.storage.claim import claimed


def test_a_second_run_is_refused_while_the_first_one_writes_and_may_follow_it(tmp_path: Path) -> None:
    out = tmp_path / "new" / "run"
    with claimed(out), pytest.raises(InputError, match="another run writes"), claimed(out):
        pass
    with claimed(out):
        pass
    assert not list(out.parent.iterdir())


def test_other_directories_are_not_locked(tmp_path: Path) -> None:
    with claimed(tmp_path / "a"), claimed(tmp_path / "b"):
        pass


def test_the_lock_is_given_back_after_an_error(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), claimed(tmp_path / "run"):
        raise RuntimeError
    with claimed(tmp_path / "run"):
        pass


@pytest.mark.parametrize("out", ["/proc/searchlight/run", "/proc/searchlight"])
def test_a_place_that_cannot_be_written_is_known_before_the_run(out: str) -> None:
    with pytest.raises(InputError, match="no place to write"), claimed(Path(out)):
        pass


class SignalAt:
    """A trace function that raises, as the handler of a signal does, before the n-th instruction of the module."""

    def __init__(self, number: int) -> None:
        self.left = number

    def __call__(self, frame: FrameType, event: str, _: object) -> "SignalAt | None":
        if frame.f_code.co_filename != claim.__file__:
            return None
        frame.f_trace_opcodes = True
        if event == "opcode":
            self.left -= 1
            if self.left == 0:
                raise StoppedError("SIGINT", 2)
        return self


def test_a_signal_at_any_moment_of_the_taking_leaves_no_lock(tmp_path: Path) -> None:
    out = tmp_path / "run"
    number, taken, former = 0, False, sys.gettrace()
    while not taken:
        number += 1
        sys.settrace(SignalAt(number))
        try:
            with claimed(out):
                sys.settrace(former)
                taken = True
        except StoppedError:
            pass
        finally:
            sys.settrace(former)
        assert list(tmp_path.iterdir()) == [], number
    assert number > 50  # it was interrupted at all these moments

"""A run directory has one writer at a time, and a writer that is known to be able to write."""

from pathlib import Path

import pytest

from pipeline.errors import InputError
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

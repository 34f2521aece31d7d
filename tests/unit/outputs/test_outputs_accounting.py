import pytest

from pipeline.outputs.accounting import StreamAccount
from pipeline.outputs.summary import SubstreamCount
from pipeline.outputs.times import clock_time, iso_time


def test_a_frame_that_is_not_accounted_for_is_an_error() -> None:
    with pytest.raises(ValueError, match="10 frames captured, but 6 processed and 3 dropped"):
        StreamAccount("s", 10, 6, {"link_full": 3})


def test_a_negative_count_is_an_error() -> None:
    with pytest.raises(ValueError, match="link_full is -1"):
        StreamAccount("s", 10, 11, {"link_full": -1})


def test_an_account_cannot_be_changed_after_it_was_checked() -> None:
    dropped = {"link_full": 4}
    account = StreamAccount("s", 10, 6, dropped)
    dropped["link_full"] = 5
    assert account.dropped_total == 4
    with pytest.raises(TypeError):
        account.dropped["link_full"] = 5  # type: ignore[index]


def test_a_substream_accounts_for_every_frame_too() -> None:
    with pytest.raises(ValueError, match="s -> d: 5 frames offered"):
        SubstreamCount("s", "d", "m", "van", 5, 3, {"late": 1}, 0)


def test_times_are_cut_to_milliseconds_in_utc() -> None:
    assert iso_time(1_777_629_600_999_999_999) == "2026-05-01T10:00:00.999Z"
    assert iso_time(0) == "1970-01-01T00:00:00.000Z"
    assert clock_time(1_777_629_600_999_999_999) == "10:00:00"

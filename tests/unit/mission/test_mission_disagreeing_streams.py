"""The line that a user reads where two streams do not agree."""

import pytest

from pipeline.config.uncertainty import Uncertainty
from pipeline.fusion.disagreement import Disagreement
from pipeline.mission import disagreeing_streams


@pytest.mark.parametrize(
    ("apart_m", "said"),
    [((3.04, -4.96), "3.0 m east and 5.0 m south"), ((-2.5, 0.26), "2.5 m west and 0.3 m north")],
)
def test_the_warning_says_who_how_far_and_what_was_stated(monkeypatch, apart_m, said):
    found = Disagreement(("drone-1", "drone-2"), apart_m, 0.44, 3)
    monkeypatch.setattr(disagreeing_streams, "disagreements", lambda *_: (found,))
    (finding,) = disagreeing_streams.check_agreement((), Uncertainty())
    line = str(finding)
    assert (finding.severity, finding.cause) == ("warning", "streams_apart")
    assert f"what drone-2 saw lies {said} of what drone-1 saw, of 3 people" in line
    assert "that is 0.4 m" in line


def test_streams_that_agree_are_not_mentioned():
    assert disagreeing_streams.check_agreement((), Uncertainty()) == []

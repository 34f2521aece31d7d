from __future__ import annotations

import math
from itertools import pairwise

from pipeline.evaluation.expected_size_classes import context_classes


def test_the_classes_leave_no_gap_and_hold_cocos_edges():
    classes = context_classes()
    assert classes[0][0] == 0.0
    assert classes[-1][1] == math.inf
    assert all(a[1] == b[0] for a, b in pairwise(classes))
    assert {32.0, 96.0} <= {low for low, _ in classes}

"""Whatever stands in a still's XMP: a finite camera of that picture, or none, and never a traceback."""

from __future__ import annotations

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.ingest.cameras.dji_calibration import TAGS, dji_camera

NUMBER = st.one_of(
    st.floats().map(repr), st.integers(-10_000, 10_000).map(str), st.sampled_from(["", "x", "1e999", "nan"])
)
TEXT = st.one_of(
    st.text(max_size=40),
    st.lists(NUMBER, max_size=13).map(",".join),
    st.lists(NUMBER, min_size=9, max_size=9).map(lambda numbers: "2025-01-01;" + ",".join(numbers)),
    st.lists(st.floats(-3000.0, 3000.0).map(repr), min_size=9, max_size=12).map(",".join),
)


@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(st.dictionaries(st.sampled_from(TAGS), TEXT), st.integers(-1, 9000), st.integers(-1, 9000))
def test_any_tags_make_a_finite_camera_or_none(tags: dict[str, str], width: int, height: int) -> None:
    camera = dji_camera(tags, width, height)
    if camera is None:
        return
    assert (camera.width, camera.height) == (width, height)
    assert np.isfinite([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion]).all()
    assert camera.fx > 0.0
    assert camera.fy > 0.0
    assert camera.focal_sd > 0.0

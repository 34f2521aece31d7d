"""Few pictures are decoded for the bursts of a video, however its key pictures lie, and each burst is another one."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.ingest.checks.bursts import BurstParams, apart_s_of, bursts_of, moments_of

RATE_HZ, SECONDS = 10, 12
PARAMS = BurstParams(width_px=64)


def film(path: Path, every: int, bframes: int = 0) -> Path:
    """Pictures of 128 x 64 whose gray is their number, a key picture each so many."""
    options = {"g": str(every), "keyint_min": str(every), "sc_threshold": "0", "bf": str(bframes), "crf": "1"}
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(RATE_HZ), options=options)
        stream.width, stream.height, stream.pix_fmt = 128, 64, "yuv420p"
        for number in range(RATE_HZ * SECONDS):
            picture = np.full((96, 128), 128, np.uint8)
            picture[:64] = 16 + number
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="yuv420p")))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize(
    ("name", "every", "bframes"), [("a.mp4", 10, 0), ("a.mp4", 120, 0), ("a.mp4", 20, 2)]
)
def test_bursts_are_distinct_and_lie_over_the_whole_video(
    tmp_path: Path, name: str, every: int, bframes: int
) -> None:
    path = film(tmp_path / name, every, bframes)
    bursts = [burst for burst, _ in bursts_of(path, float(SECONDS), None, PARAMS)]
    begun = np.array([b.times_s[0] for b in bursts])
    assert len(begun) >= PARAMS.least
    assert (np.diff(begun) > 0.0).all()
    assert begun[0] < 1.0
    assert begun[-1] > SECONDS - 3.0
    for burst in bursts:
        first_s, between_s, last_s = burst.times_s
        assert 0.25 <= between_s - first_s < 0.5 <= last_s - first_s < 0.8
        for time_s, picture in zip(burst.times_s, burst.pictures, strict=True):
            assert picture.shape == (32, 64)
            # luma 16 + number, of 219 steps, seen as gray of 255
            assert abs(float(picture.mean()) / 255.0 * 219.0 - RATE_HZ * time_s) < 1.5


def test_a_container_without_an_index_gives_a_burst_for_each_key_picture(tmp_path: Path) -> None:
    path = film(tmp_path / "a.mkv", 20)
    begun = [burst.times_s[0] for burst, _ in bursts_of(path, float(SECONDS), None, PARAMS)]
    assert begun == [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]


def test_a_large_video_is_decoded_at_few_key_pictures_and_a_small_one_at_all_moments() -> None:
    keys_s = np.arange(0.0, 1200.0, 1.0)
    large, small = 3840 * 2160, 512 * 288
    params, of_two = BurstParams(), BurstParams(most_pixels=0.6e9)
    assert len(moments_of(keys_s, 1200.0, 30.0, large, 0.25, of_two)) == params.least
    assert len(moments_of(keys_s, 1200.0, 30.0, large, 0.25, params)) == 15
    assert len(moments_of(keys_s, 1200.0, 30.0, small, 0.5, params)) == params.most
    assert len(moments_of(keys_s[:12], 12.0, 30.0, small, 0.5, params)) == params.most
    assert apart_s_of(30.0, large, of_two) == params.less_apart_s
    assert apart_s_of(30.0, large, params) == apart_s_of(30.0, small, params) == params.apart_s


def test_long_ways_between_key_pictures_are_not_decoded_for_more_than_they_may_cost() -> None:
    pixels, params = 3840 * 2160, BurstParams()
    keys_s = np.array([0.0, 400.0, 410.0])  # ten minutes of 4K between two key pictures
    moments_s = moments_of(keys_s, 1200.0, 30.0, pixels, 0.5, params)
    of_key = np.searchsorted(keys_s, moments_s, side="right")
    assert len(set(of_key.tolist())) == len(moments_s)
    assert len(moments_of(np.zeros(1), 1200.0, 30.0, 64 * 64, 0.5, params)) == params.most


@pytest.mark.parametrize("duration_s", [0.0, 0.1, 0.3])
def test_a_video_shorter_than_a_burst_has_none(duration_s: float) -> None:
    assert len(moments_of(np.zeros(0), duration_s, 30.0, 1, 0.5, BurstParams())) == 0


def test_pictures_of_another_size_than_the_cameras_are_not_compared(tmp_path: Path) -> None:
    path = film(tmp_path / "a.mp4", 10)
    assert list(bursts_of(path, float(SECONDS), (64, 128), PARAMS)) == []
    (_, scale), *_ = bursts_of(path, float(SECONDS), (128, 64), PARAMS)
    assert scale == 2.0

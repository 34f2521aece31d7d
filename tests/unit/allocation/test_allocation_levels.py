"""Codecs, expected size and sharing: what the pool says becomes what the problem says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pipeline.allocation.levels import accuracies_of, levels_of, of_size, stream_accuracies
from pipeline.allocation.sharing import sharing_modes
from pipeline.config.pool import Pool, PoolDetector
from pipeline.config.processing import Processing
from pipeline.errors import InputError

WHERE = Path("mission.yaml")
BITRATES = (1e6, 4e6)


def processing(**changes: Any) -> Processing:
    fields = {
        "frame_rate": {"hertz": 10},
        "max_processing_time": {"seconds": 1},
        "bitrates": [{"mbps": 4}, {"mbps": 1}],
    }
    return Processing.model_validate({**fields, **changes})


def network(**changes: Any) -> PoolDetector:
    fields = {
        "id": "net",
        "memory": {"gigabytes": 1},
        "accuracy": [{"bitrate": {"mbps": 1}, "accuracy": 0.5}, {"bitrate": {"mbps": 4}, "accuracy": 0.8}],
        "times": [{"machine": "cpu", "mean": {"milliseconds": 20}}],
    }
    return PoolDetector.model_validate({**fields, **changes})


def with_codec(codec: str, accuracy: float) -> dict[str, Any]:
    return {"codec": codec, "bitrate": {"mbps": 1}, "accuracy": accuracy}


def test_without_codecs_a_level_is_a_bitrate() -> None:
    levels = levels_of(processing(), BITRATES)
    assert [(level.bitrate_bps, level.codec) for level in levels] == [(1e6, ""), (4e6, "")]
    assert accuracies_of(network(), levels, "h264", WHERE) == (0.5, 0.8)


def test_with_codecs_every_bitrate_comes_once_with_each() -> None:
    levels = levels_of(processing(codecs=["h264", "av1"]), BITRATES)
    assert [(level.bitrate_bps / 1e6, level.codec) for level in levels] == [
        (1.0, "h264"),
        (1.0, "av1"),
        (4.0, "h264"),
        (4.0, "av1"),
    ]
    measured = network(accuracy_by_codec=[with_codec("h264", 0.4), with_codec("av1", 0.6)])
    assert accuracies_of(measured, levels, "h264", WHERE) == (0.4, 0.6, 0.4, 0.6)


def test_a_mission_in_one_codec_is_planned_with_that_codecs_accuracies() -> None:
    levels = levels_of(processing(), BITRATES)
    measured = network(accuracy_by_codec=[with_codec("h265", 0.7)])
    assert accuracies_of(measured, levels, "h265", WHERE) == (0.7, 0.7)
    assert accuracies_of(measured, levels, "vp9", WHERE) == (0.5, 0.8)


def test_a_codec_that_the_pool_has_nothing_of_is_named() -> None:
    levels = levels_of(processing(codecs=["vp9"]), BITRATES)
    with pytest.raises(InputError, match=r"net.accuracy_by_codec: found nothing for vp9"):
        accuracies_of(network(), levels, "h264", WHERE)


SIZES = [{"size": s, "bitrate": {"mbps": 1}, "accuracy": a} for s, a in (("small", 0.2), ("medium", 0.6))]


@pytest.mark.parametrize(
    ("size_px", "accuracies"), [(10.0, [0.2]), (32.0, [0.2]), (33.0, [0.6]), (96.0, [0.6]), (97.0, [])]
)
def test_the_size_class_is_cocos(size_px: float, accuracies: list[float]) -> None:
    assert [row.accuracy for row in of_size(network(accuracy_by_size=SIZES), size_px)] == accuracies


def test_a_context_of_the_pool_is_finer_than_a_size_class() -> None:
    context = [
        {"person_px_from": 24.0, "person_px_below": 32.0, "bitrate": {"mbps": 1}, "accuracy": 0.35},
    ]
    rich = network(accuracy_by_size=SIZES, accuracy_by_context=context)
    assert [row.accuracy for row in of_size(rich, 24.0)] == [0.35]
    assert [row.accuracy for row in of_size(rich, 31.9)] == [0.35]
    assert [row.accuracy for row in of_size(rich, 32.0)] == [0.2]


def test_expected_size_is_off_unless_asked_for() -> None:
    pool = Pool(detectors=(network(accuracy_by_size=SIZES),))
    levels = levels_of(processing(), BITRATES)
    assert stream_accuracies(processing(), pool, levels, {"v": 20.0}, WHERE) == {}
    asked = processing(expected_size=True)
    assert stream_accuracies(asked, pool, levels, {"v": 20.0, "w": 200.0}, WHERE) == {
        ("v", "net"): (0.2, 0.2)
    }


def test_a_size_under_a_codec_is_scaled_as_the_codec_is_to_all() -> None:
    measured = network(accuracy_by_size=SIZES, accuracy_by_codec=[with_codec("h265", 0.25)])
    asked = processing(expected_size=True, codecs=["h265"])
    levels = levels_of(asked, (1e6,))
    found = stream_accuracies(asked, Pool(detectors=(measured,)), levels, {"v": 50.0}, WHERE)
    assert found["v", "net"] == pytest.approx((0.6 * 0.25 / 0.5,))


def test_sharing_makes_a_mode_of_every_company_measured() -> None:
    measured = network(sharing=[{"detectors": 3, "factor": 2.1}, {"detectors": 2, "factor": 1.4}])
    assert [(m.detectors, m.factor, m.suffix) for m in sharing_modes(processing(), measured, WHERE)] == [
        (None, 1.0, "")
    ]
    asked = processing(sharing=True)
    assert [(m.detectors, m.factor, m.suffix) for m in sharing_modes(asked, measured, WHERE)] == [
        (1, 1.0, "@1"),
        (2, 1.4, "@2"),
        (3, 2.1, "@3"),
    ]
    with pytest.raises(InputError, match=r"net.sharing: found nothing, and processing.sharing is on"):
        sharing_modes(asked, network(), WHERE)

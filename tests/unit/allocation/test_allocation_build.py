"""From a mission, an inventory and a pool to the problem; what cannot be used is named."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from pipeline.allocation.build import build_problem, max_frame_time_s, period_of
from pipeline.allocation.problem import Problem
from pipeline.config.inventory import Inventory
from pipeline.config.pool import AccuracyAt, Pool
from pipeline.config.processing import Processing
from pipeline.errors import InputError
from pipeline.sensor.accuracy import accuracy_at

WHERE = Path("mission.yaml")


def processing(**changes: Any) -> Processing:
    fields = {
        "frame_rate": {"hertz": 10},
        "max_processing_time": {"seconds": 1},
        "bitrates": [{"mbps": 4}, {"mbps": 1}],
    }
    return Processing.model_validate({**fields, **changes})


def inventory(**changes: Any) -> Inventory:
    fields = {
        "sites": [
            {"id": "drone", "machines": [{"id": "m", "type": "small", "memory": {"gigabytes": 2}}]},
            {
                "id": "ground",
                "machines": [{"id": "g", "type": "big", "memory": {"gigabytes": 8}, "count": 2}],
            },
        ],
        "links": [{"stream": "v", "site": "ground", "bandwidth": {"mbps": 5}}],
    }
    return Inventory.model_validate({**fields, **changes})


def pool_detector(name: str, **milliseconds: float) -> dict[str, Any]:
    return {
        "id": name,
        "memory": {"gigabytes": 1},
        "accuracy": [{"bitrate": {"mbps": 1}, "accuracy": 0.5}, {"bitrate": {"mbps": 4}, "accuracy": 0.9}],
        "times": [{"machine": m, "mean": {"milliseconds": t}} for m, t in milliseconds.items()],
    }


def pool(*detectors: dict[str, Any]) -> Pool:
    return Pool.model_validate({"detectors": detectors or [pool_detector("net", small=150, big=40)]})


def build(
    p: Processing | None = None, i: Inventory | None = None, of: Pool | None = None, own: str = "drone"
) -> Problem:
    return build_problem({"v": own}, p or processing(), i or inventory(), of or pool(), where=WHERE)


def test_every_network_stands_on_every_machine_that_has_a_time_for_it() -> None:
    problem = build()
    found = [(d.id, d.site, d.period, d.execution_s) for d in problem.detectors]
    assert found == [
        ("m:net", "drone", 2, 0.15),
        ("g:net", "ground", 1, 0.04),
        ("g-2:net", "ground", 1, 0.04),
    ]
    assert problem.cycle == 2
    assert [m.id for m in problem.machines] == ["m", "g", "g-2"]


def test_the_own_site_is_reached_without_a_limit_and_other_sites_by_their_links() -> None:
    problem = build()
    assert (problem.link("v", "drone"), problem.link("v", "ground")) == (math.inf, 5e6)
    assert build(own="air").link("v", "drone") == 0.0


def test_levels_come_ascending_with_their_accuracy() -> None:
    problem = build()
    assert problem.bitrates_bps == (1e6, 4e6)
    assert problem.detectors[0].accuracy == (0.5, 0.9)


def test_levels_above_every_link_are_left_out() -> None:
    narrow = inventory(links=[{"stream": "v", "site": "ground", "bandwidth": {"mbps": 2}}])
    assert build(i=narrow, own="air").bitrates_bps == (1e6,)
    assert build(i=narrow).bitrates_bps == (1e6, 4e6), "the own site's link has no limit"


def test_a_period_is_the_time_in_frames_rounded_up() -> None:
    assert [period_of(t, 30.0) for t in (0.001, 1 / 30, 0.034, 0.1, 0.1001)] == [1, 1, 2, 3, 4]


@pytest.mark.parametrize("rate_hz", [3.0, 7.0, 10.0, 25.0, 30.0, 100.0])
def test_a_time_of_whole_frames_takes_that_many(rate_hz: float) -> None:
    """Also where the product is a little more than the whole number: 0.07 s at 100 Hz is 7.000000000000001."""
    assert [period_of(k / rate_hz, rate_hz) for k in range(1, 300)] == list(range(1, 300))
    in_milliseconds = [ms for ms in range(1, 3000) if ms * rate_hz % 1000 == 0]
    assert in_milliseconds
    assert [period_of(ms / 1000, rate_hz) for ms in in_milliseconds] == [
        ms * rate_hz / 1000 for ms in in_milliseconds
    ]


def test_the_maximum_time_counts_where_the_pool_has_it() -> None:
    detector = pool_detector("net", small=150, big=40)
    detector["times"][1]["maximum"] = {"milliseconds": 120}
    assert [d.period for d in build(of=pool(detector)).detectors] == [2, 2, 2]


def test_the_time_allowed_is_the_lesser_of_the_deadline_and_what_the_detectors_can_share() -> None:
    assert max_frame_time_s(processing(detectors_per_stream=3)) == pytest.approx(0.3)
    assert max_frame_time_s(processing(max_processing_time={"milliseconds": 50})) == pytest.approx(0.05)
    quick = build(processing(max_processing_time={"milliseconds": 40}))
    assert [d.id for d in quick.detectors] == ["g:net", "g-2:net"]
    assert [d.id for d in build(processing(detectors_per_stream=1)).detectors] == ["g:net", "g-2:net"]


def test_accuracy_is_linear_in_the_logarithm_of_the_bitrate_and_level_beyond_the_points() -> None:
    points = (
        AccuracyAt.model_validate({"bitrate": {"mbps": 4}, "accuracy": 0.9}),
        AccuracyAt.model_validate({"bitrate": {"mbps": 1}, "accuracy": 0.5}),
    )
    found = [accuracy_at(points, bps) for bps in (0.1e6, 1e6, 2e6, 4e6, 20e6)]
    assert found == pytest.approx([0.5, 0.5, 0.7, 0.9, 0.9])


def test_a_machine_type_without_times_is_refused() -> None:
    with pytest.raises(InputError, match=r"inventory machine m\.type: found 'small'.*pool: big"):
        build(of=pool(pool_detector("net", big=40)))


def test_a_detector_that_names_only_machines_that_are_not_there_is_refused() -> None:
    odd = pool(pool_detector("net", small=150, big=40), pool_detector("odd", tpu=1))
    with pytest.raises(InputError, match=r"pool\.detectors\.odd\.times: found .*tpu; expected .*big, small"):
        build(of=odd)


def test_a_stream_that_no_link_serves_is_refused() -> None:
    with pytest.raises(InputError, match=r"streams\.v: found no link to any site, and no site 'air'"):
        build(i=inventory(links=[]), own="air")


def test_bitrates_above_every_link_are_refused() -> None:
    thin = inventory(links=[{"stream": "v", "site": "ground", "bandwidth": {"kbps": 500}}])
    with pytest.raises(InputError, match=r"processing\.bitrates: found .*1e\+06 bps.*at most 500000 bps"):
        build(i=thin, own="air")


def test_a_bitrate_given_twice_is_refused() -> None:
    with pytest.raises(InputError, match=r"processing\.bitrates: found 1e\+06 bps twice"):
        build(processing(bitrates=[{"mbps": 1}, {"kbps": 1000}]))


def test_a_pool_without_a_detector_that_is_fast_enough_is_refused() -> None:
    with pytest.raises(InputError, match=r"net on g, takes 0\.04 s; expected at most 0\.03 s"):
        build(processing(max_processing_time={"milliseconds": 30}))

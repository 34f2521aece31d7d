"""Cells, places, errors, people and networks: what does not go together is said, what does is not."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pipeline.allocation.plan import Plan
from pipeline.config.pool import OperatingPoint
from pipeline.ingest.finding import Finding
from pipeline.mission.people_in_networks import PersonInNetwork, check_networks, people_in_networks
from pipeline.mission.planning import plan
from pipeline.mission.prepared import PreparedMission, prepare
from pipeline.mission.proportions import check_proportions


@pytest.fixture(scope="module")
def prepared(small_mission: Path) -> PreparedMission:
    return prepare(small_mission)


@pytest.fixture(scope="module")
def planned(prepared: PreparedMission) -> Plan:
    return plan(prepared)


def found(prepared: PreparedMission, errors: dict[str, float] | None = None, **fusion: Any) -> list[Finding]:
    mission = prepared.mission
    uncertainty = mission.fusion.uncertainty.model_copy(update=errors or {})
    changed = mission.fusion.model_copy(update={"uncertainty": uncertainty, **fusion})
    return check_proportions(replace(prepared, mission=mission.model_copy(update={"fusion": changed})))


@pytest.mark.parametrize(("cell_m", "cluster_m"), [(0.5, 2.0), (0.25, 2.0), (1.0, 2.0), (2.0, 2.0)])
def test_sizes_that_go_together_are_not_spoken_of(
    prepared: PreparedMission, cell_m: float, cluster_m: float
) -> None:
    errors = {"position_noise": 0.2, "position_bias": 1.3}
    assert found(prepared, errors, cell_size=cell_m, cluster_distance=cluster_m) == []


@pytest.mark.parametrize(("cell_m", "cluster_m"), [(1.0, 0.5), (2.0, 1.9), (0.5, 0.1)])
def test_a_cluster_distance_below_the_cell_size_does_nothing_and_that_is_said(
    prepared: PreparedMission, cell_m: float, cluster_m: float
) -> None:
    (finding,) = found(prepared, {"position_noise": 0.3}, cell_size=cell_m, cluster_distance=cluster_m)
    assert (finding.severity, finding.cause) == ("warning", "cluster_distance")
    assert f"people nearer than {2 * cell_m:g} m are one" in finding.found
    assert f"{{meters: {max(2.0, 2 * cell_m):g}}}" in finding.mend


@pytest.mark.parametrize(
    ("errors", "fusion", "said"),
    [
        ({"position_noise": 3.0}, {"cell_size": 0.5}, "far finer than places are known"),
        ({"attitude_noise": math.radians(15.0)}, {"cell_size": 0.25}, "far finer than places are known"),
        ({"position_noise": 0.01}, {"cell_size": 3.0, "cluster_distance": 6.0}, "cells of 3 m"),
        ({"position_noise": 0.5}, {"cell_size": 0.5, "update_rule": "paper"}, "under the paper's rule"),
        ({"position_noise": 9.0}, {"cell_size": 2.0}, "nobody can be found"),
    ],
)
def test_cells_and_errors_that_do_not_go_together_are_named(
    prepared: PreparedMission, errors: dict[str, float], fusion: dict[str, Any], said: str
) -> None:
    (finding,) = found(prepared, errors, **fusion)
    assert finding.severity == "warning"
    assert said in finding.found
    assert finding.mend


def test_a_person_in_a_network_is_as_high_as_the_pinhole_says(
    prepared: PreparedMission, planned: Plan
) -> None:
    people = people_in_networks(prepared, planned)
    assert [(p.stream, p.detector) for p in people] == [
        (a.stream, a.pool_detector) for a in planned.assignments
    ]
    camera = prepared.cameras["drone-1"]
    for person in people:
        # 9 m up, 45 degrees down
        assert person.distance_m == pytest.approx(9.0 * math.sqrt(2.0), rel=0.15)
        across_m = (1.7 + 0.5) * math.sqrt(0.5)
        size = prepared.input_sizes[person.detector]
        assert size is not None
        scale = min(size[0] / camera.width, size[1] / camera.height)
        expected = camera.fy * across_m / person.distance_m * scale
        assert person.network_px == pytest.approx(expected, rel=0.05)
        assert person.pod is None
    assert check_networks(prepared, planned) == []


@pytest.mark.parametrize("factor", [8.0, 12.0])
def test_who_flies_too_high_for_the_network_is_warned(
    prepared: PreparedMission, planned: Plan, factor: float
) -> None:
    """The same as a camera of a shorter focal length."""
    cameras = {name: replace(c, fx=c.fx / factor, fy=c.fy / factor) for name, c in prepared.cameras.items()}
    high = replace(prepared, cameras=cameras)
    near, far = people_in_networks(prepared, planned), people_in_networks(high, planned)
    for one, other in zip(near, far, strict=True):
        assert other.network_px == pytest.approx(one.network_px / factor)
        assert other.network_px < 12.0 < one.network_px
    warned = check_networks(high, planned)
    assert len(warned) == len(planned.assignments)
    assert {f.cause for f in warned} == {"small_in_network"}


def test_the_sentence_says_distance_pixels_and_probability() -> None:
    person = PersonInNetwork("drone-1", "small", 80.2, 9.1, 0.31)
    said = (
        "at 80 m a person is 9 pixels high in the network of small; "
        "its probability of detection in one frame is 0.3"
    )
    assert person.sentence == said
    unknown = replace(person, pod=None)
    assert unknown.sentence.endswith("its probability of detection in one frame was not measured")
    assert (person.is_hard, replace(person, pod=0.29).is_hard) == (False, True)
    assert (unknown.is_hard, replace(unknown, network_px=12.5).is_hard) == (True, False)


def test_the_probability_is_the_measured_one_or_none(prepared: PreparedMission, planned: Plan) -> None:
    bitrates = sorted({a.bitrate_bps for a in planned.assignments})
    shares = ((4.0, 8.0, 0.1), (8.0, 16.0, 0.2), (16.0, 2000.0, 0.7))
    found = [{"person_px_from": a, "person_px_below": b, "share": s, "people": 99} for a, b, s in shares]
    points = tuple(
        OperatingPoint.model_validate(
            {
                "codec": "h264",
                "bitrate": {"bps": b},
                "found": found,
                "picture_width": 512,
                "false_boxes": 0.1,
            }
        )
        for b in (bitrates[0], 2 * bitrates[-1])
    )
    people = people_in_networks(with_points(prepared, points), planned)
    assert all(p.pod is not None and 0.2 < p.pod <= 0.7 for p in people)
    assert all(p.pod is None for p in people_in_networks(with_points(prepared, ()), planned))


def with_points(prepared: PreparedMission, points: tuple[OperatingPoint, ...]) -> PreparedMission:
    """The mission with a pool of which so much is known."""
    detectors = tuple(d.model_copy(update={"operating_points": points}) for d in prepared.pool.detectors)
    return replace(prepared, pool=prepared.pool.model_copy(update={"detectors": detectors}))


def test_a_network_that_looks_at_tiles_sees_people_larger(prepared: PreparedMission, planned: Plan) -> None:
    camera = prepared.cameras["drone-1"]
    tiled = [
        replace(a, setup=replace(a.setup, tiling=_tiling(camera.width // 2, camera.height // 2)))
        for a in planned.assignments
    ]
    whole = people_in_networks(prepared, planned)
    halves = people_in_networks(prepared, replace(planned, assignments=tuple(tiled)))
    for one, other in zip(whole, halves, strict=True):
        assert other.network_px == pytest.approx(2.0 * one.network_px)


def _tiling(width: int, height: int) -> Any:
    from pipeline.sensor.setup import Tiling

    return Tiling(width, height, 0.2, False)

import time

import pytest

from pipeline.config.mission import load_mission
from pipeline.config.shipped import shipped
from pipeline.mission.controller.orders import Solve
from pipeline.mission.load.controller_load import controller_load
from pipeline.mission.load.inventory import RATE_HZ, load_problem, planned
from pipeline.mission.load.reducer_load import result_cost_s


class Ticks:
    """A clock by which every step takes a millisecond."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        self.now += 0.001
        return self.now


@pytest.mark.parametrize(("streams", "sites"), [(4, 1), (9, 2), (16, 4)])
def test_all_streams_fly_and_every_frame_is_a_result(streams: int, sites: int) -> None:
    load = controller_load(streams, sites, 2.0, 1e9, Ticks())
    assert (load.flying, load.streams, load.sites) == (streams, streams, sites)
    assert load.watched_s == pytest.approx(2.0, abs=0.3)
    assert load.results == pytest.approx(streams * RATE_HZ, rel=0.2)
    assert load.cores == pytest.approx(load.steps * 0.001, rel=1e-6)


def test_more_than_there_is_time_for_is_said() -> None:
    load = controller_load(16, 4, 2.0, 0.5, Ticks())
    assert load.watched_s == 0.0
    assert load.flying < 16


@pytest.mark.parametrize(("streams", "sites"), [(1, 1), (10, 3), (100, 100)])
def test_the_plan_serves_every_stream_at_its_site_within_the_memory(streams: int, sites: int) -> None:
    problem = load_problem(streams, sites)
    (answer,) = planned(Solve(1, problem, ()))
    assert {a.stream for a in answer.assignments} == set(problem.streams)
    for machine in problem.machines:
        held = sum(a.machine == machine.id for a in answer.assignments)
        assert held * problem.detectors[0].memory_bytes <= machine.memory_bytes
    assert all(problem.link(a.stream, a.site) > 0.0 for a in answer.assignments)


def test_a_result_costs_the_reducer_something() -> None:
    fusion = load_mission(shipped("missions", "demo", "mission.yaml")).fusion
    assert 1e-5 < result_cost_s(fusion, 40, time.process_time) < 1.0

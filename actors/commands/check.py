"""The command ``searchlight check``: everything that would keep a mission from running, without running it."""

from __future__ import annotations

from pathlib import Path

from actors.nodes import joined
from actors.terminal import say
from pipeline.mission.find_mission import find_mission
from pipeline.mission.near_files import here
from pipeline.mission.noticed import noticed
from pipeline.mission.prepared import prepare
from pipeline.mission.stopping import Stop


def check_mission(mission: Path | None, address: str | None) -> None:
    """address: of a cluster, on whose nodes files are looked at. Raises InputError for what keeps it from running."""
    mission = find_mission(mission)
    with joined(mission, address, Stop()) as near:
        mission = mission if near is here else mission.absolute()
        prepared = noticed(prepare(mission, near=near), near)
        # only now: the solver takes 50 MB, which the decoders of large videos have given back by then
        from pipeline.mission.one_picture import push_one_picture
        from pipeline.mission.people_in_networks import check_networks, people_in_networks
        from pipeline.mission.planning import plan

        result = plan(prepared)
        pushed = push_one_picture(prepared, result) if near is here else []
    for finding in (*prepared.findings, *pushed, *check_networks(prepared, result)):
        say(str(finding))
    for person in people_in_networks(prepared, result):
        say(f"{person.stream}: {person.sentence}")
    for a in result.assignments:
        rate_hz = prepared.mission.processing.frame_rate / a.period
        say(f"planned: {a.stream}: {a.pool_detector} looks at {rate_hz:g} pictures a second, on {a.machine}")
    if near is not here:
        say("not tried: a picture on its way through the detectors, since videos are on their drones")
    streams = "1 stream" if len(prepared.streams) == 1 else f"{len(prepared.streams)} streams"
    say(f"{mission}: usable; {streams}; plan: {result.status}, objective {result.objective:.4g}")

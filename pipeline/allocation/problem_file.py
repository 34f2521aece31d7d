"""From a problem file to the allocation problem."""

from __future__ import annotations

from pathlib import Path

from pipeline.allocation.build import build_problem
from pipeline.allocation.problem import Problem
from pipeline.config.inventory import Inventory, load_inventory, require_streams
from pipeline.config.pool import load_pool
from pipeline.config.problem import AllocationProblem, PlannedStream
from pipeline.sensor.expected_size import expected_person_px


def problem_of(stated: AllocationProblem, path: Path) -> Problem:
    """The problem that a file states. path: of the file. Raises InputError naming file and field."""
    inventory = _with_links_of_copies(stated.streams, load_inventory(stated.inventory), stated.inventory)
    return build_problem(
        {name: stream.site for stream in stated.streams for name in stream.names},
        stated.processing,
        inventory,
        load_pool(stated.pool),
        where=path,
        person_px={
            name: expected_person_px(stream.view.height, stream.view.pitch, stream.view.focal_px)
            for stream in stated.streams
            if stream.view is not None
            for name in stream.names
        },
    )


def _with_links_of_copies(streams: tuple[PlannedStream, ...], inventory: Inventory, where: Path) -> Inventory:
    """Every copy of a stream gets the links of the first."""
    names = {stream.id: stream.names for stream in streams}
    require_streams(inventory, where, names, "the problem")
    links = tuple(
        link.model_copy(update={"stream": name}) for link in inventory.links for name in names[link.stream]
    )
    return inventory.model_copy(update={"links": links})
